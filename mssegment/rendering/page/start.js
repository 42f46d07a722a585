// From here on the script draws, instead of the still picture.
document.body.classList.add("live");
stage.tabIndex = 0;
stage.setAttribute("role", "application");
stage.setAttribute("aria-label", "Frame with tracks; the arrow keys select a track");
stage.setAttribute("aria-describedby", "keys");
$("keys").hidden = false;
$("all").hidden = data.styles.length < 4;
$("player").hidden = frames < 2;
$("slider").max = String(frames);
$("slider").addEventListener("input", (event) => { blink(false); showFrame(Number(event.target.value) - 1); });
$("back").addEventListener("click", () => { blink(false); showFrame(state.frame - 1); });
$("forward").addEventListener("click", () => { blink(false); showFrame(state.frame + 1); });
$("blink").addEventListener("click", () => blink(state.blinking === null));
if (frames > 3) {
  $("blink").textContent = "Play";
  $("blink-name").textContent = "playing";
}
new ResizeObserver(fit).observe(stage);
showFrame(0);
fit();

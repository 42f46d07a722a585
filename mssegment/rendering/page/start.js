// Brings the page to life: from here on the script draws instead of the still picture.
document.body.classList.add("live");
stage.tabIndex = 0;
stage.setAttribute("role", "application");
stage.setAttribute("aria-label", "Picture with tracks; the arrow keys go from track to track");
stage.setAttribute("aria-describedby", "keys");
$("keys").hidden = false;
$("all").hidden = data.looks.length < 4;
$("player").hidden = frames < 2;
$("slider").max = String(frames);
$("slider").addEventListener("input", (event) => { flick(false); showFrame(Number(event.target.value) - 1); });
$("back").addEventListener("click", () => { flick(false); showFrame(state.frame - 1); });
$("forward").addEventListener("click", () => { flick(false); showFrame(state.frame + 1); });
$("flick").addEventListener("click", () => flick(state.flicking === null));
if (frames > 3) $("flick").textContent = "Play";
new ResizeObserver(fit).observe(stage);
showFrame(0);
fit();

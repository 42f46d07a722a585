// One track: found with the pointer or the keyboard, described beside the picture.
const text = (tag, content, name) => {
  const element = document.createElement(tag);
  element.textContent = content;
  if (name) element.className = name;
  return element;
};
const digits = (value) => (Number.isFinite(value) ? value.toFixed(Math.abs(value) < 10 ? 2 : 1) : "–");
const residual = (row, track) => residuals[row * tracks + track];
const named = (label) => looks.get(label)?.name.replace("outliers", "outlier") ?? String(label);

function describe(track) {
  const box = $("details");
  const list = document.createElement("dl");
  const line = (name, value, kind) => list.append(text("dt", name), text("dd", value, kind));
  const key = (look) => {
    const glyph = text("span", look.glyph, `key ${look.class}`);
    glyph.setAttribute("aria-hidden", "true");
    return glyph;
  };
  line("found", ` ${named(labels[track])}`);
  if (looks.has(labels[track])) list.lastChild.prepend(key(looks.get(labels[track])));
  if (truth !== null) {
    const word = truth[track] > 0 ? `motion ${truth[track]}` : truth[track] === 0 ? "outlier" : "ignored";
    line("true", word + (wrong[track] ? ", wrong" : ""), wrong[track] ? "wrong" : "");
  }
  if (seen(track, state.frame)) {
    const [x, y] = place(track, state.frame);
    line("here", `x ${(x - 0.5).toFixed(1)}, y ${(y - 0.5).toFixed(1)}`);
  }
  const [first, last] = firstAndLast[track];
  if (first >= 0 && last > first) {
    const [x0, y0] = place(track, first), [x1, y1] = place(track, last);
    line("moved", `${digits(Math.hypot(x1 - x0, y1 - y0))} px (${digits(x1 - x0)}, ${digits(y1 - y0)})`);
  }
  motions.slice(0, 8).forEach((look, row) => {
    const limit = look.limit === null ? "" : ` of ${digits(look.limit)}`;
    line(`to motion ${look.label} `, `${digits(residual(row, track))}${limit} px`);
    list.lastChild.previousSibling.append(key(look));
  });
  const find = text("button", "Find it in the table", "link");
  find.type = "button";
  find.addEventListener("click", () => findInTable(track));
  box.replaceChildren(text("h3", `Track ${track + 1}`), list, find);
  box.hidden = false;
}

function choose(track) {
  if (track === state.chosen) return;
  state.chosen = track;
  drawChoice();
  if (track >= 0) describe(track);
  markRow();
}

function nearest(event) {
  const box = stage.getBoundingClientRect();
  const ratio = box.width / data.frames[state.frame].width;
  const x = (event.clientX - box.left) / ratio, y = (event.clientY - box.top) / ratio;
  let best = -1, least = (14 / ratio) ** 2;
  for (let track = 0; track < tracks; track++) {
    if (!seen(track, state.frame)) continue;
    const [px, py] = place(track, state.frame);
    const distance = (px - x) ** 2 + (py - y) ** 2;
    if (distance < least && visible(track)) [best, least] = [track, distance];
  }
  return best;
}
stage.addEventListener("pointermove", (event) => {
  const track = nearest(event);
  if (track >= 0) choose(track);
});
stage.addEventListener("click", (event) => {
  const track = nearest(event);
  if (track >= 0) findInTable(track);
});

function step(by) {
  for (let i = 1; i <= tracks; i++) {
    const start = state.chosen < 0 && by > 0 ? -1 : Math.max(state.chosen, 0);
    const track = (((start + by * i) % tracks) + tracks) % tracks;
    if (visible(track)) return choose(track);
  }
}
stage.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const actions = {
    ArrowRight: () => step(1),
    ArrowLeft: () => step(-1),
    ",": () => showFrame(state.frame - 1),
    ".": () => showFrame(state.frame + 1),
    " ": () => flick(state.flicking === null),
    Enter: () => state.chosen >= 0 && findInTable(state.chosen),
    Escape: () => choose(-1),
  };
  const number = /^[1-9]$/.test(event.key) && looks.has(Number(event.key));
  if (number) document.querySelector(`[data-label="${event.key}"]`).click();
  else if (actions[event.key]) actions[event.key]();
  else return;
  event.preventDefault();
});

// One track: selected with the pointer or the keyboard, described beside the picture.
const text = (tag, content, name) => {
  const element = document.createElement(tag);
  element.textContent = content;
  if (name) element.className = name;
  return element;
};
const digits = (value) => (Number.isFinite(value) ? value.toFixed(Math.abs(value) < 10 ? 2 : 1) : "–");
const residual = (row, track) => residuals[row * tracks + track];
const trueName = (label) => (label > 0 ? String(label) : label === 0 ? data.zero : "ignored");
const nameOf = (label) => styles.get(label)?.name.replace("outliers", "outlier") ?? String(label);

function describe(track) {
  const box = $("details");
  const list = document.createElement("dl");
  const line = (name, value, kind) => list.append(text("dt", name), text("dd", value, kind));
  const key = (style) => {
    const glyph = text("span", style.glyph, `key ${style.class}`);
    glyph.setAttribute("aria-hidden", "true");
    return glyph;
  };
  line("found", ` ${nameOf(labels[track])}`);
  if (styles.has(labels[track])) list.lastChild.prepend(key(styles.get(labels[track])));
  if (truth !== null) {
    const word = truth[track] > 0 ? `motion ${truth[track]}` : trueName(truth[track]);
    line("true", word + (misclassified[track] ? " (error)" : ""), misclassified[track] ? "error" : "");
  }
  if (isVisible(track, state.frame)) {
    const [x, y] = position(track, state.frame);
    line("position", `x ${(x - 0.5).toFixed(1)}, y ${(y - 0.5).toFixed(1)}`);
  }
  const [first, last] = firstAndLast[track];
  if (first >= 0 && last > first) {
    const [x0, y0] = position(track, first), [x1, y1] = position(track, last);
    line("displacement", `${digits(Math.hypot(x1 - x0, y1 - y0))} px`);
    line("dx, dy", `${digits(x1 - x0)}, ${digits(y1 - y0)}`);
  }
  motions.slice(0, 8).forEach((style, row) => {
    const own = residual(row, track);
    const limit = style.limit === null ? "" : ` (max ${digits(style.limit)})`;
    line("residual ", Number.isFinite(own) ? `${digits(own)} ${data.unit}${limit}` : "–");
    list.lastChild.title = `Largest residual of an inlier: ${digits(style.limit ?? NaN)} ${data.unit}`;
    list.lastChild.previousSibling.append(key(style), ` ${style.label}`);
  });
  const find = text("button", "Show in the table", "link");
  find.type = "button";
  find.addEventListener("click", () => findInTable(track));
  box.replaceChildren(text("h3", `Track ${track + 1}`), list, find);
  box.hidden = false;
}

function select(track) {
  if (track === state.selected) return;
  state.selected = track;
  drawSelection();
  if (track >= 0) describe(track);
  else $("details").hidden = true;
  markRow();
}

function nearest(event) {
  const box = stage.getBoundingClientRect();
  const ratio = box.width / data.frames[state.frame].width;
  const x = (event.clientX - box.left) / ratio, y = (event.clientY - box.top) / ratio;
  let best = -1, least = (14 / ratio) ** 2;
  for (let track = 0; track < tracks; track++) {
    if (!isVisible(track, state.frame)) continue;
    const [px, py] = position(track, state.frame);
    const distance = (px - x) ** 2 + (py - y) ** 2;
    if (distance < least && isShown(track)) [best, least] = [track, distance];
  }
  return best;
}
stage.addEventListener("pointermove", (event) => {
  const track = nearest(event);
  if (track >= 0) select(track);
});
stage.addEventListener("click", (event) => {
  const track = nearest(event);
  if (track >= 0) findInTable(track);
});

function step(by) {
  for (let i = 1; i <= tracks; i++) {
    const start = state.selected < 0 && by > 0 ? -1 : Math.max(state.selected, 0);
    const track = (((start + by * i) % tracks) + tracks) % tracks;
    if (isShown(track)) return select(track);
  }
}
stage.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const actions = {
    ArrowRight: () => step(1),
    ArrowLeft: () => step(-1),
    ",": () => showFrame(state.frame - 1),
    ".": () => showFrame(state.frame + 1),
    " ": () => blink(state.blinking === null),
    Enter: () => state.selected >= 0 && findInTable(state.selected),
    Escape: () => select(-1),
  };
  const number = /^[1-9]$/.test(event.key) && styles.has(Number(event.key));
  if (number) document.querySelector(`[data-label="${event.key}"]`).click();
  else if (actions[event.key]) actions[event.key]();
  else return;
  event.preventDefault();
});

// The picture: canvases over the photograph, the frames, and the display options.
// one canvas per label, so that hiding and showing a label needs no drawing
const layers = [...data.styles].reverse().map((style) => ({ style, ...makeCanvas() }));
const numbers = makeCanvas();
const errors = makeCanvas();
const selection = makeCanvas();
errors.canvas.hidden = true;

function makeCanvas() {
  const canvas = document.createElement("canvas");
  canvas.setAttribute("aria-hidden", "true");
  stage.append(canvas);
  return { canvas, context: canvas.getContext("2d") };
}

const numberPlaces = new Map(); // label/frame -> position of its number
let scale = 1; // canvas pixels per frame pixel
let unit = 1; // canvas pixels per CSS pixel
function fit() {
  const box = stage.getBoundingClientRect();
  const size = data.frames[state.frame];
  unit = Math.min(2, window.devicePixelRatio || 1);
  const width = Math.max(1, Math.round(box.width * unit));
  const height = Math.max(1, Math.round((box.width * unit * size.height) / size.width));
  for (const { canvas } of [...layers, numbers, errors, selection]) {
    if (canvas.width !== width || canvas.height !== height) {
      canvas.width = width;
      canvas.height = height;
    }
  }
  scale = width / size.width;
  numberPlaces.clear();
  draw();
}

function trace(context, shape, x, y, radius) {
  const outline = data.outlines[shape];
  context.moveTo(x + outline[0][0] * radius, y + outline[0][1] * radius);
  for (let i = 1; i < outline.length; i++) {
    context.lineTo(x + outline[i][0] * radius, y + outline[i][1] * radius);
  }
  context.closePath();
}

// markers shrink where they would overlap
function radiusOf(style) {
  const most = 4.2 * Math.min(1.25, Math.max(0.7, stage.clientWidth / 900)) * unit;
  const radius = Math.min(most, Math.max(0.57 * most, 0.5 * data.spacing * scale));
  return style.quiet ? 0.62 * radius : radius;
}

function drawDisplacements(context, style, list) {
  context.strokeStyle = style.colour;
  context.globalAlpha = style.quiet ? 0.3 : 0.45;
  context.lineWidth = (style.quiet ? 0.9 : 1.5) * unit;
  const arrows = [];
  context.beginPath();
  for (const track of list) {
    const [first, last] = firstAndLast[track];
    if (first < 0 || !isVisible(track, state.frame)) continue;
    if (!showsDisplacement[track] && last - first <= TRAIL_FRAMES) continue;
    const long = last - first > TRAIL_FRAMES;
    const from = long ? Math.max(first, state.frame - TRAIL_FRAMES) : first;
    const to = long ? state.frame : last;
    let pen = false;
    for (let f = from; f <= to; f++) {
      if (!isVisible(track, f)) continue;
      const [x, y] = position(track, f);
      if (pen) context.lineTo(x * scale, y * scale);
      else context.moveTo(x * scale, y * scale);
      pen = true;
    }
    if (!long) arrows.push([position(track, from), position(track, to)]);
  }
  context.stroke();
  context.beginPath();
  arrows.forEach(([start, end]) => traceArrowhead(context, start, end, 4 * context.lineWidth));
  context.fillStyle = style.colour;
  context.fill();
  context.globalAlpha = 1;
}

// an arrowhead where a displacement ends, if it is long enough for one
function traceArrowhead(context, start, end, size) {
  const dx = (end[0] - start[0]) * scale, dy = (end[1] - start[1]) * scale;
  const length = Math.hypot(dx, dy);
  if (length < 2.2 * size) return;
  const ax = (dx / length) * size, ay = (dy / length) * size;
  const x = end[0] * scale, y = end[1] * scale;
  context.moveTo(x + 0.4 * ax, y + 0.4 * ay);
  context.lineTo(x - 1.1 * ax - 0.6 * ay, y - 1.1 * ay + 0.6 * ax);
  context.lineTo(x - 1.1 * ax + 0.6 * ay, y - 1.1 * ay - 0.6 * ax);
  context.closePath();
}

function drawLayer(layer) {
  const { style, canvas, context } = layer;
  layer.stale = canvas.hidden; // drawn when it is shown again
  if (layer.stale) return;
  context.clearRect(0, 0, canvas.width, canvas.height);
  const list = members.get(style.label);
  if ($("show-displacements").checked) drawDisplacements(context, style, list);
  if (!$("show-points").checked) return;
  context.beginPath();
  const radius = radiusOf(style);
  for (const track of list) {
    if (!isVisible(track, state.frame)) continue;
    const [x, y] = position(track, state.frame);
    trace(context, style.shape, x * scale, y * scale, radius);
  }
  if (!style.quiet) {
    context.lineWidth = 0.5 * radius;
    context.strokeStyle = "#fff";
    context.stroke();
  }
  context.fillStyle = style.colour;
  context.fill();
}

// the numbers of the motions have a layer of their own, over all markers
function drawNumbers() {
  const { canvas, context } = numbers;
  context.clearRect(0, 0, canvas.width, canvas.height);
  if (!$("show-points").checked) return;
  for (const { style, canvas: layer } of layers) {
    if (!style.quiet && !layer.hidden) drawNumber(context, style);
  }
}

// the number of a motion lies on its object: at a free inlier, the nearest to the median
function numberPlace(label) {
  const key = `${label}/${state.frame}`;
  if (!numberPlaces.has(key)) {
    const tracks = members.get(label).filter((track) => isVisible(track, state.frame));
    const here = tracks.map((track) => position(track, state.frame));
    const middle = [0, 1].map((axis) => {
      const sorted = here.map((p) => p[axis]).sort((a, b) => a - b);
      return sorted[sorted.length >> 1];
    });
    const far = (p) => (p[0] - middle[0]) ** 2 + (p[1] - middle[1]) ** 2;
    here.sort((a, b) => far(a) - far(b));
    // not on the number of a motion before this one
    const gap = (24 * unit) / scale;
    const taken = motions
      .filter((one) => one.label < label && !one.quiet)
      .map((one) => numberPlace(one.label))
      .filter((place) => place !== null);
    const free = (p) => taken.every(([x, y]) => Math.hypot(p[0] - x, p[1] - y) >= gap);
    numberPlaces.set(key, here.find(free) ?? here[0] ?? null);
  }
  return numberPlaces.get(key);
}

function drawNumber(context, style) {
  const found = numberPlace(style.label);
  if (found === null) return;
  const [x, y] = found;
  const radius = 11 * unit;
  context.beginPath();
  context.arc(x * scale, y * scale, radius, 0, 2 * Math.PI);
  context.fillStyle = style.colour;
  context.fill();
  context.lineWidth = 2 * unit;
  context.strokeStyle = "#fff";
  context.stroke();
  context.fillStyle = style.ink;
  context.font = `700 ${radius * (style.label > 9 ? 1.1 : 1.35)}px system-ui, sans-serif`;
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillText(String(style.label), x * scale, y * scale + 0.05 * radius);
}

function drawErrors() {
  const { canvas, context } = errors;
  context.clearRect(0, 0, canvas.width, canvas.height);
  if (canvas.hidden) return;
  for (const [width, colour] of [[4.5, "#fff"], [2, "#d50000"]]) {
    context.beginPath();
    for (let track = 0; track < tracks; track++) {
      if (!misclassified[track] || !isVisible(track, state.frame)) continue;
      const [x, y] = position(track, state.frame);
      context.moveTo(x * scale + 8 * unit, y * scale);
      context.arc(x * scale, y * scale, 8 * unit, 0, 2 * Math.PI);
    }
    context.lineWidth = width * unit;
    context.strokeStyle = colour;
    context.stroke();
  }
}

function drawSelection() {
  const { canvas, context } = selection;
  context.clearRect(0, 0, canvas.width, canvas.height);
  const track = state.selected;
  if (track < 0) return;
  for (const [width, colour] of [[5, "#fff"], [2.5, "#111"]]) {
    context.lineWidth = width * unit;
    context.strokeStyle = colour;
    context.beginPath();
    let pen = false;
    for (let f = 0; f < frames; f++) {
      if (!isVisible(track, f)) continue;
      const [x, y] = position(track, f);
      if (pen) context.lineTo(x * scale, y * scale);
      else context.moveTo(x * scale, y * scale);
      pen = true;
    }
    context.stroke();
    if (!isVisible(track, state.frame)) continue;
    const [x, y] = position(track, state.frame);
    context.beginPath();
    context.arc(x * scale, y * scale, 11 * unit, 0, 2 * Math.PI);
    context.stroke();
  }
}

function draw() {
  layers.forEach(drawLayer);
  drawNumbers();
  drawErrors();
  drawSelection();
}

function showFrame(index) {
  state.frame = (index + frames) % frames;
  photographs.forEach((picture, i) => picture.classList.toggle("current", i === state.frame));
  $("slider").value = String(state.frame + 1);
  const name = data.frames[state.frame].name;
  $("frame-name").textContent = `${state.frame + 1} / ${frames}  ${name}`;
  $("slider").setAttribute("aria-valuetext", `frame ${state.frame + 1} of ${frames}, ${name}`);
  draw();
}

function blink(on) {
  clearInterval(state.blinking);
  state.blinking = on ? setInterval(() => showFrame(state.frame + 1), frames > 3 ? 200 : 650) : null;
  $("blink").setAttribute("aria-pressed", String(on));
}

function toggle(label, on) {
  const layer = layers.find((one) => one.style.label === label);
  layer.canvas.hidden = !on;
  if (on && layer.stale) drawLayer(layer);
  drawNumbers();
  document.body.classList.toggle(`hide-${layer.style.class}`, !on);
}
$("labels").addEventListener("change", (event) => {
  toggle(Number(event.target.dataset.label), event.target.checked);
});
for (const [button, on] of [["show-all", true], ["show-none", false]]) {
  $(button).addEventListener("click", () => {
    for (const box of document.querySelectorAll("#labels input")) {
      if (box.checked !== on) box.click();
    }
  });
}
$("show-points").addEventListener("change", draw);
$("show-displacements").addEventListener("change", draw);
$("show-photo").addEventListener("change", (event) => {
  stage.classList.toggle("no-photo", !event.target.checked);
});
const errorCount = misclassified.reduce((sum, one) => sum + one, 0);
if (truth !== null) {
  $("errors-toggle").hidden = false;
  $("error-count").textContent = String(errorCount);
  $("show-errors").addEventListener("change", (event) => {
    errors.canvas.hidden = !event.target.checked;
    drawErrors();
  });
}
const isShown = (track) => {
  const layer = layers.find((one) => one.style.label === labels[track]);
  return layer !== undefined && !layer.canvas.hidden && isVisible(track, state.frame);
};

// The picture: one canvas per label over the photograph, the frames, and the switches.
// one canvas per label: a switch hides or shows it, nothing is drawn again
const layers = [...data.looks].reverse().map((look) => ({ look, ...makeCanvas() }));
const numbers = makeCanvas();
const rings = makeCanvas();
const choice = makeCanvas();
rings.canvas.hidden = true;

function makeCanvas() {
  const canvas = document.createElement("canvas");
  canvas.setAttribute("aria-hidden", "true");
  stage.append(canvas);
  return { canvas, context: canvas.getContext("2d") };
}

let scale = 1; // canvas pixels per frame pixel
let unit = 1; // canvas pixels per CSS pixel
function fit() {
  const box = stage.getBoundingClientRect();
  const size = data.frames[state.frame];
  unit = Math.min(2, window.devicePixelRatio || 1);
  const width = Math.max(1, Math.round(box.width * unit));
  const height = Math.max(1, Math.round((box.width * unit * size.height) / size.width));
  for (const { canvas } of [...layers, numbers, rings, choice]) {
    if (canvas.width !== width || canvas.height !== height) {
      canvas.width = width;
      canvas.height = height;
    }
  }
  scale = width / size.width;
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

// markers shrink where they would cover each other
function radiusOf(look) {
  const most = 4.2 * Math.min(1.25, Math.max(0.7, stage.clientWidth / 900)) * unit;
  const radius = Math.min(most, Math.max(0.57 * most, 0.5 * data.spacing * scale));
  return look.label > 0 ? radius : 0.62 * radius;
}

function drawWays(context, look, list) {
  context.strokeStyle = look.colour;
  context.globalAlpha = look.label > 0 ? 0.6 : 0.35;
  context.lineWidth = (look.label > 0 ? 1.5 : 0.9) * unit;
  const arrows = [];
  context.beginPath();
  for (const track of list) {
    const [first, last] = firstAndLast[track];
    if (first < 0 || !seen(track, state.frame)) continue;
    if (!carriers[track] && last - first <= RECENT) continue;
    const long = last - first > RECENT;
    const from = long ? Math.max(first, state.frame - RECENT) : first;
    const to = long ? state.frame : last;
    let pen = false;
    for (let f = from; f <= to; f++) {
      if (!seen(track, f)) continue;
      const [x, y] = place(track, f);
      if (pen) context.lineTo(x * scale, y * scale);
      else context.moveTo(x * scale, y * scale);
      pen = true;
    }
    if (!long) arrows.push([place(track, from), place(track, to)]);
  }
  context.stroke();
  context.beginPath();
  arrows.forEach(([start, end]) => traceHead(context, start, end, 4 * context.lineWidth));
  context.fillStyle = look.colour;
  context.fill();
  context.globalAlpha = 1;
}

// an arrow head where a way ends, if the way is long enough to carry one
function traceHead(context, start, end, size) {
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
  const { look, canvas, context } = layer;
  layer.stale = canvas.hidden; // to be drawn when it is shown again
  if (layer.stale) return;
  context.clearRect(0, 0, canvas.width, canvas.height);
  const list = members.get(look.label);
  if ($("show-ways").checked) drawWays(context, look, list);
  if (!$("show-points").checked) return;
  context.beginPath();
  const radius = radiusOf(look);
  for (const track of list) {
    if (!seen(track, state.frame)) continue;
    const [x, y] = place(track, state.frame);
    trace(context, look.shape, x * scale, y * scale, radius);
  }
  if (look.label > 0) {
    context.lineWidth = 0.5 * radius;
    context.strokeStyle = "#fff";
    context.stroke();
  }
  context.fillStyle = look.colour;
  context.fill();
}

// the numbers lie over all markers, in a layer of their own
function drawNumbers() {
  const { canvas, context } = numbers;
  context.clearRect(0, 0, canvas.width, canvas.height);
  if (!$("show-points").checked) return;
  for (const { look, canvas: layer } of layers) {
    if (look.label > 0 && !layer.hidden) drawNumber(context, look);
  }
}

// the number of a motion lies on its object: at the inlier nearest to the median of all
const numberPlaces = new Map();
function numberPlace(label) {
  const key = `${label}/${state.frame}`;
  if (!numberPlaces.has(key)) {
    const tracks = members.get(label).filter((track) => seen(track, state.frame));
    const here = tracks.map((track) => place(track, state.frame));
    const middle = [0, 1].map((axis) => {
      const sorted = here.map((p) => p[axis]).sort((a, b) => a - b);
      return sorted[sorted.length >> 1];
    });
    const far = (p) => (p[0] - middle[0]) ** 2 + (p[1] - middle[1]) ** 2;
    const nearest = (best, p) => (far(p) < far(best) ? p : best);
    numberPlaces.set(key, here.length ? here.reduce(nearest) : null);
  }
  return numberPlaces.get(key);
}

function drawNumber(context, look) {
  const found = numberPlace(look.label);
  if (found === null) return;
  const [x, y] = found;
  const radius = 11 * unit;
  context.beginPath();
  context.arc(x * scale, y * scale, radius, 0, 2 * Math.PI);
  context.fillStyle = look.colour;
  context.fill();
  context.lineWidth = 2 * unit;
  context.strokeStyle = "#fff";
  context.stroke();
  context.fillStyle = look.ink;
  context.font = `700 ${radius * (look.label > 9 ? 1.1 : 1.35)}px system-ui, sans-serif`;
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillText(String(look.label), x * scale, y * scale + 0.05 * radius);
}

function drawRings() {
  const { canvas, context } = rings;
  context.clearRect(0, 0, canvas.width, canvas.height);
  if (canvas.hidden) return;
  for (const [width, colour] of [[4.5, "#fff"], [2, "#d50000"]]) {
    context.beginPath();
    for (let track = 0; track < tracks; track++) {
      if (!wrong[track] || !seen(track, state.frame)) continue;
      const [x, y] = place(track, state.frame);
      context.moveTo(x * scale + 8 * unit, y * scale);
      context.arc(x * scale, y * scale, 8 * unit, 0, 2 * Math.PI);
    }
    context.lineWidth = width * unit;
    context.strokeStyle = colour;
    context.stroke();
  }
}

function drawChoice() {
  const { canvas, context } = choice;
  context.clearRect(0, 0, canvas.width, canvas.height);
  const track = state.chosen;
  if (track < 0) return;
  for (const [width, colour] of [[5, "#fff"], [2.5, "#111"]]) {
    context.lineWidth = width * unit;
    context.strokeStyle = colour;
    context.beginPath();
    let pen = false;
    for (let f = 0; f < frames; f++) {
      if (!seen(track, f)) continue;
      const [x, y] = place(track, f);
      if (pen) context.lineTo(x * scale, y * scale);
      else context.moveTo(x * scale, y * scale);
      pen = true;
    }
    context.stroke();
    if (!seen(track, state.frame)) continue;
    const [x, y] = place(track, state.frame);
    context.beginPath();
    context.arc(x * scale, y * scale, 11 * unit, 0, 2 * Math.PI);
    context.stroke();
  }
}

function draw() {
  layers.forEach(drawLayer);
  drawNumbers();
  drawRings();
  drawChoice();
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

function flick(on) {
  clearInterval(state.flicking);
  state.flicking = on ? setInterval(() => showFrame(state.frame + 1), frames > 3 ? 200 : 650) : null;
  $("flick").setAttribute("aria-pressed", String(on));
}

function toggle(label, on) {
  const layer = layers.find((one) => one.look.label === label);
  layer.canvas.hidden = !on;
  if (on && layer.stale) drawLayer(layer);
  drawNumbers();
  document.body.classList.toggle(`hide-${layer.look.class}`, !on);
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
$("show-ways").addEventListener("change", draw);
$("show-photo").addEventListener("change", (event) => {
  stage.classList.toggle("no-photo", !event.target.checked);
});
const mistakes = wrong.reduce((sum, one) => sum + one, 0);
if (truth !== null) {
  $("wrong-toggle").hidden = false;
  $("wrong-count").textContent = String(mistakes);
  $("show-wrong").addEventListener("change", (event) => {
    rings.canvas.hidden = !event.target.checked;
    drawRings();
  });
}
const visible = (track) => {
  const layer = layers.find((one) => one.look.label === labels[track]);
  return layer !== undefined && !layer.canvas.hidden && seen(track, state.frame);
};

"use strict";
(async () => {
  const $ = (id) => document.getElementById(id);
  const state = await (await fetch("state.json")).json();
  const { frames, styles } = state;
  const polygons = state.polygons;
  const colours = new Map(styles.map((style) => [style.label, style.colour]));
  const glyphs = new Map(styles.map((style) => [style.label, style.glyph]));
  const NONE = 0, IGNORE = 255;
  const canvas = $("canvas"), context = canvas.getContext("2d");
  let frame = 0, vertices = [], crosshair = null, unsaved = false;

  const nameOf = (label) =>
    label === NONE ? "0 static world (erase)" : label === IGNORE ? "255 ignore" : `${glyphs.get(label) ?? ""} motion ${label}`;
  const colourOf = (label) => (label === NONE ? "#000000" : label === IGNORE ? "#8a8a93" : colours.get(label) ?? "#ffffff");
  for (const label of [...Array(20).keys()].map((i) => i + 1).concat([NONE, IGNORE])) {
    const option = document.createElement("option");
    option.value = String(label);
    option.textContent = nameOf(label);
    $("label").append(option);
  }

  const scale = () => canvas.width / frames[frame].width;
  function fit() {
    const ratio = Math.min(2, window.devicePixelRatio || 1);
    const box = $("stage").getBoundingClientRect();
    canvas.width = Math.max(1, Math.round(box.width * ratio));
    canvas.height = Math.max(1, Math.round((canvas.width * frames[frame].height) / frames[frame].width));
    draw();
  }
  function outline(points, closed) {
    context.beginPath();
    points.forEach(([x, y], i) => {
      const place = [(x + 0.5) * scale(), (y + 0.5) * scale()];
      if (i) context.lineTo(...place);
      else context.moveTo(...place);
    });
    if (closed) context.closePath();
  }
  function stroke(colour, width) {
    context.lineWidth = width * 2.2;
    context.strokeStyle = "#fff";
    context.stroke();
    context.lineWidth = width;
    context.strokeStyle = colour;
    context.stroke();
  }
  function draw() {
    context.clearRect(0, 0, canvas.width, canvas.height);
    for (const { label, points } of polygons[frame]) {
      outline(points, true);
      context.globalAlpha = 0.35;
      context.fillStyle = colourOf(label);
      context.fill();
      context.globalAlpha = 1;
      stroke(colourOf(label), 2);
    }
    const colour = colourOf(Number($("label").value));
    if (vertices.length) {
      outline(crosshair ? [...vertices, crosshair] : vertices, false);
      stroke(colour, 2);
      for (const [x, y] of vertices) {
        context.beginPath();
        context.arc((x + 0.5) * scale(), (y + 0.5) * scale(), 4, 0, 2 * Math.PI);
        context.fillStyle = colour;
        context.fill();
        stroke("#111", 1);
      }
    }
    if (crosshair) {
      const [x, y] = crosshair.map((value) => (value + 0.5) * scale());
      context.beginPath();
      context.moveTo(x - 12, y);
      context.lineTo(x + 12, y);
      context.moveTo(x, y - 12);
      context.lineTo(x, y + 12);
      stroke(colour, 1.5);
    }
  }
  function list() {
    $("list").replaceChildren(...polygons[frame].map((polygon, i) => {
      const item = document.createElement("li");
      item.textContent = `${nameOf(polygon.label)}, ${polygon.points.length} vertices`;
      const remove = document.createElement("button");
      remove.type = "button";
      remove.textContent = "Delete";
      remove.setAttribute("aria-label", `Delete polygon ${i + 1}, ${nameOf(polygon.label)}`);
      remove.addEventListener("click", () => {
        polygons[frame].splice(i, 1);
        changed();
      });
      item.append(remove);
      return item;
    }));
  }
  function changed() {
    unsaved = true;
    list();
    draw();
  }
  const showStatus = (text) => { $("status").textContent = text; };

  function show(index) {
    frame = Math.min(Math.max(index, 0), frames.length - 1);
    vertices = [];
    $("photo").src = `frame-${frame}.jpg`;
    $("photo").alt = `Frame ${frame + 1}: ${frames[frame].name}`;
    $("photo").width = frames[frame].width;
    $("photo").height = frames[frame].height;
    $("frame").value = String(frame + 1);
    $("frame-name").textContent = `${frame + 1} / ${frames.length}  ${frames[frame].name}`;
    $("copy").disabled = frame === 0;
    list();
    fit();
  }
  function add(point) {
    vertices.push(point);
    draw();
  }
  function close() {
    // a double-click adds the last vertex twice
    const near = ([ax, ay], [bx, by]) => Math.hypot(ax - bx, ay - by) < 1;
    vertices = vertices.filter((vertex, i) => i === 0 || !near(vertex, vertices[i - 1]));
    if (vertices.length < 3) return showStatus("A polygon needs at least three vertices.");
    polygons[frame].push({ label: Number($("label").value), points: vertices });
    showStatus(`Added polygon ${polygons[frame].length}: ${nameOf(Number($("label").value))}.`);
    vertices = [];
    changed();
  }
  function undo() {
    if (vertices.length) vertices.pop();
    else if (polygons[frame].length) vertices = polygons[frame].pop().points;
    changed();
  }
  async function save() {
    if (vertices.length >= 3) close();
    try {
      const answer = await fetch("save", {
        method: "POST",
        headers: { "Content-Type": "application/json" },
        body: JSON.stringify({ frames: polygons }),
      });
      const text = await answer.text();
      showStatus(answer.ok ? text : `Not saved: ${text}`);
      unsaved = unsaved && !answer.ok;
    } catch {
      showStatus("Not saved: the program in the terminal has stopped.");
    }
  }

  const stage = $("stage");
  const where = (event) => {
    const box = stage.getBoundingClientRect();
    const ratio = frames[frame].width / box.width;
    const clamp = (value, most) => Math.min(Math.max(value, -0.5), most - 0.5);
    return [
      clamp((event.clientX - box.left) * ratio - 0.5, frames[frame].width),
      clamp((event.clientY - box.top) * ratio - 0.5, frames[frame].height),
    ];
  };
  stage.addEventListener("pointermove", (event) => { crosshair = where(event); draw(); });
  stage.addEventListener("pointerleave", () => { crosshair = null; draw(); });
  stage.addEventListener("click", (event) => { add(where(event)); });
  stage.addEventListener("dblclick", close);
  const middle = () => [frames[frame].width / 2, frames[frame].height / 2];
  const move = (dx, dy, far) => {
    const [x, y] = crosshair ?? middle();
    const step = far ? 1 : Math.max(4, frames[frame].width / 100);
    crosshair = [
      Math.min(Math.max(x + dx * step, 0), frames[frame].width - 1),
      Math.min(Math.max(y + dy * step, 0), frames[frame].height - 1),
    ];
    draw();
  };
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.target.closest("select, input, button")) return;
    const actions = {
      ArrowLeft: () => move(-1, 0, event.shiftKey),
      ArrowRight: () => move(1, 0, event.shiftKey),
      ArrowUp: () => move(0, -1, event.shiftKey),
      ArrowDown: () => move(0, 1, event.shiftKey),
      " ": () => add(crosshair ?? middle()),
      Enter: close,
      Backspace: undo,
      Escape: () => { vertices = []; draw(); },
      ",": () => show(frame - 1),
      ".": () => show(frame + 1),
      s: save,
    };
    if (/^[1-9]$/.test(event.key)) $("label").value = event.key;
    else if (actions[event.key]) actions[event.key]();
    else return;
    event.preventDefault();
    draw();
  });
  $("label").addEventListener("change", draw);
  $("frame").addEventListener("input", () => show(Number($("frame").value) - 1));
  $("close").addEventListener("click", close);
  $("undo").addEventListener("click", undo);
  $("copy").addEventListener("click", () => {
    polygons[frame].push(...structuredClone(polygons[frame - 1]));
    changed();
  });
  $("save").addEventListener("click", save);
  window.addEventListener("beforeunload", (event) => { if (unsaved) event.preventDefault(); });
  $("frame").max = String(frames.length);
  $("frames").hidden = frames.length < 2;
  new ResizeObserver(fit).observe(stage);
  show(0);
  stage.focus();
})();

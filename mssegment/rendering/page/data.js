// The numbers of the page, and how the other scripts read them.
const $ = (id) => document.getElementById(id);
const data = JSON.parse($("data").textContent);

const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
const NOT_VISIBLE = -32768;
const points = new Int16Array(bytes(data.points).buffer);
const labels = new Int16Array(bytes(data.labels).buffer);
const truth = data.truth === null ? null : new Int16Array(bytes(data.truth).buffer);
const misclassified = bytes(data.misclassified);
const showsDisplacement = bytes(data.displacements); // of all tracks where there is space
const residuals = new Float32Array(bytes(data.residuals).buffer);
const frames = data.frames.length;
const tracks = data.tracks;
const styles = new Map(data.styles.map((style) => [style.label, style]));
const motions = data.styles.filter((style) => style.label > 0);
const TRAIL_FRAMES = 12; // longer tracks are drawn as trails over the last frames

const stage = $("stage");
const photographs = [...stage.querySelectorAll(".frame")];
const state = { frame: 0, selected: -1, blinking: null };

// positions in pixels of the frame; the centre of the first pixel is at 1/2
const isVisible = (track, frame) => points[2 * (track * frames + frame)] !== NOT_VISIBLE;
const position = (track, frame) => {
  const at = 2 * (track * frames + frame);
  return [points[at] / data.stepsPerPixel + 0.5, points[at + 1] / data.stepsPerPixel + 0.5];
};
const firstAndLast = Array.from({ length: tracks }, (_, track) => {
  let first = -1, last = -1;
  for (let f = 0; f < frames; f++) {
    if (!isVisible(track, f)) continue;
    if (first < 0) first = f;
    last = f;
  }
  return [first, last];
});
const members = new Map(data.styles.map((style) => [style.label, []]));
for (let track = 0; track < tracks; track++) members.get(labels[track])?.push(track);

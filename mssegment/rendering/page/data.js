// The numbers of the page, and what is asked of them everywhere.
const $ = (id) => document.getElementById(id);
const data = JSON.parse($("data").textContent);

const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
const UNSEEN = -32768;
const points = new Int16Array(bytes(data.points).buffer);
const labels = new Int16Array(bytes(data.labels).buffer);
const truth = data.truth === null ? null : new Int16Array(bytes(data.truth).buffer);
const wrong = bytes(data.wrong);
const carriers = bytes(data.carriers); // the tracks whose way is drawn: all, where there is room
const residuals = new Float32Array(bytes(data.residuals).buffer);
const frames = data.frames.length;
const tracks = data.tracks;
const looks = new Map(data.looks.map((look) => [look.label, look]));
const motions = data.looks.filter((look) => look.label > 0);
const RECENT = 12; // of a longer sequence only the last steps of a way are drawn

const stage = $("stage");
const photographs = [...stage.querySelectorAll(".frame")];
const state = { frame: 0, chosen: -1, flicking: null };

// positions in pixels of the frame; the centre of the first pixel is at a half
const seen = (track, frame) => points[2 * (track * frames + frame)] !== UNSEEN;
const place = (track, frame) => {
  const at = 2 * (track * frames + frame);
  return [points[at] / data.steps + 0.5, points[at + 1] / data.steps + 0.5];
};
const ends = (track) => {
  let first = -1, last = -1;
  for (let f = 0; f < frames; f++) {
    if (!seen(track, f)) continue;
    if (first < 0) first = f;
    last = f;
  }
  return [first, last];
};
const firstAndLast = Array.from({ length: tracks }, (_, track) => ends(track));
const members = new Map(data.looks.map((look) => [look.label, []]));
for (let track = 0; track < tracks; track++) members.get(labels[track])?.push(track);

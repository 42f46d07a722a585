// The table of tracks: pages, order, filter, and links between rows and the picture.
const ROWS_PER_PAGE = 25;
const table = $("track-table");
const body = table?.tBodies[0];
const order = { column: 0, down: false };
let shown = [...Array(tracks).keys()];
let page = 0;

function bestTwo(track) {
  const all = motions.map((_, row) => residual(row, track));
  const own = motions.findIndex((style) => style.label === labels[track]);
  const first = own >= 0 ? own : all.reduce((b, v, i) => (v < (all[b] ?? Infinity) ? i : b), 0);
  const rest = all.filter((v, i) => i !== first && Number.isFinite(v));
  return [all[first] ?? NaN, rest.length ? Math.min(...rest) : NaN];
}
const displacement = (track) => {
  const [first, last] = firstAndLast[track];
  if (first < 0 || last === first) return NaN;
  const [x0, y0] = position(track, first), [x1, y1] = position(track, last);
  return Math.hypot(x1 - x0, y1 - y0);
};
const columns = [
  (track) => track,
  (track) => labels[track],
  (track) => (truth === null ? 0 : truth[track]),
  (track) => bestTwo(track)[0],
  (track) => bestTwo(track)[1],
  displacement,
];

function row(track) {
  const line = document.createElement("tr");
  line.dataset.track = String(track);
  const head = document.createElement("th");
  head.scope = "row";
  const link = text("button", String(track + 1), "link");
  link.type = "button";
  link.setAttribute("aria-label", `Show track ${track + 1} in the picture`);
  link.addEventListener("click", () => {
    select(track);
    stage.scrollIntoView({ block: "nearest" });
    stage.focus({ preventScroll: true });
  });
  head.append(link);
  const found = document.createElement("td");
  const style = styles.get(labels[track]);
  if (labels[track] !== 0 && style) {
    const key = text("span", style.glyph, `key ${style.class}`);
    key.setAttribute("aria-hidden", "true");
    found.append(key, ` ${labels[track] > 0 ? labels[track] : style.name}`);
  } else found.textContent = "-";
  const [own, other] = bestTwo(track);
  const cells = [
    truth === null ? "" : `${trueName(truth[track])}${misclassified[track] ? " (error)" : ""}`,
    digits(own), digits(other), digits(displacement(track)),
  ];
  line.append(head, found, ...cells.map((cell) => text("td", cell)));
  // not where the page scrolls below a pointer at rest
  line.addEventListener("pointermove", (event) => {
    if (event.movementX || event.movementY) select(track);
  });
  return line;
}

function fill() {
  const pages = Math.max(1, Math.ceil(shown.length / ROWS_PER_PAGE));
  page = Math.min(Math.max(page, 0), pages - 1);
  body.replaceChildren(...shown.slice(page * ROWS_PER_PAGE, (page + 1) * ROWS_PER_PAGE).map(row));
  $("page-name").textContent = `${shown.length} tracks, page ${page + 1} of ${pages}`;
  markRow();
}
function markRow() {
  if (!body) return;
  for (const line of body.rows) {
    line.classList.toggle("selected", Number(line.dataset.track) === state.selected);
  }
}
function filterAndSort() {
  const value = $("filter").value;
  shown = [];
  for (let track = 0; track < tracks; track++) {
    if (value === "all" || (value === "errors" ? misclassified[track] : labels[track] === Number(value))) {
      shown.push(track);
    }
  }
  const key = columns[order.column];
  const keys = new Map(shown.map((track) => [track, key(track)]));
  const worst = order.down ? -Infinity : Infinity;
  const valueOf = (track) => (Number.isNaN(keys.get(track)) ? worst : keys.get(track));
  shown.sort((a, b) => (valueOf(a) - valueOf(b) || 0) * (order.down ? -1 : 1) || a - b);
  page = 0;
  fill();
}
function findInTable(track) {
  select(track);
  if (!shown.includes(track)) {
    $("filter").value = "all";
    filterAndSort();
  }
  page = Math.floor(shown.indexOf(track) / ROWS_PER_PAGE);
  fill();
  const line = [...body.rows].find((one) => Number(one.dataset.track) === track);
  line.scrollIntoView({ block: "center" });
  line.querySelector("button").focus({ preventScroll: true });
}

if (table) {
  const option = (value, name) => {
    const element = text("option", name);
    element.value = String(value);
    $("filter").append(element);
  };
  if (errorCount) option("errors", `errors (${errorCount})`);
  data.styles.forEach((style) => option(style.label, `${style.glyph} ${style.name}`));
  $("filter").addEventListener("change", filterAndSort);
  $("page-back").addEventListener("click", () => { page -= 1; fill(); });
  $("page-forward").addEventListener("click", () => { page += 1; fill(); });
  [...table.tHead.rows[0].cells].forEach((cell, i) => {
    const button = text("button", cell.textContent, "link");
    button.type = "button";
    button.addEventListener("click", () => {
      order.down = order.column === i ? !order.down : false;
      order.column = i;
      [...table.tHead.rows[0].cells].forEach((one) => one.removeAttribute("aria-sort"));
      cell.setAttribute("aria-sort", order.down ? "descending" : "ascending");
      filterAndSort();
    });
    cell.replaceChildren(button);
  });
  $("pager").hidden = false;
  fill();
}

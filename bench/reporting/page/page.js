"use strict";
(() => {
  const PAGE = 50;
  const data = JSON.parse(document.getElementById("rows").textContent);
  const { columns, words } = data;
  // Name, heading, digits after the point; null for a column of words.
  const SHOWN = [
    ["iou", "IoU %", 1], ["coverage", "TPR %", 1], ["recording", "recording", null], ["camera", "camera", null],
    ["time_s", "time (s)", 2], ["track_id", "object", null], ["object_class", "class", null], ["category", "kind", null],
    ["outcome", "outcome", null], ["false_px", "false px", 0], ["region_px", "object px", 0], ["range_m", "range (m)", 1],
    ["ego_kmh", "ego (km/h)", 1], ["points", "points", 0],
  ];
  const by = (id) => document.getElementById(id);
  const head = document.querySelector("#objects thead tr"), body = document.querySelector("#objects tbody");
  const filters = [...document.querySelectorAll("[data-filter]")];
  const texts = Array.from({ length: data.rows }, (_, row) =>
    ["recording", "camera", "track_id", "object_class", "category", "outcome"].map((name) => word(name, row)).join(" ").toLowerCase());
  let sorted = { name: "coverage", down: false }, order = [], page = 0;

  function word(name, row) { return words[name][columns[name][row]]; }

  function make(tag, text, parent, className) {
    const element = document.createElement(tag);
    element.textContent = text;
    if (className) element.className = className;
    if (parent) parent.append(element);
    return element;
  }

  function shown(name, digits, row) {
    if (digits === null) return word(name, row);
    const value = columns[name][row];
    return value === null ? "" : value.toFixed(digits);
  }

  // The dictionaries are in order, so the indices of words compare as the words do. Empty cells come last both ways.
  function compare(a, b) {
    const left = columns[sorted.name][a], right = columns[sorted.name][b];
    if (left === right) return a - b;
    if (left === null) return 1;
    if (right === null) return -1;
    return sorted.down ? right - left : left - right;
  }

  function refresh() {
    const asked = by("search").value.toLowerCase().split(/\s+/).filter(Boolean);
    const wanted = filters.filter((select) => select.value !== "").map((select) => [select.dataset.filter, Number(select.value)]);
    const pictured = by("pictured").checked;
    order = [];
    for (let row = 0; row < data.rows; row += 1) {
      if (pictured && !columns.picture[row]) continue;
      if (wanted.some(([name, index]) => columns[name][row] !== index)) continue;
      if (asked.every((part) => texts[row].includes(part))) order.push(row);
    }
    order.sort(compare);
    page = 0;
    draw();
  }

  function draw() {
    const last = Math.max(0, Math.ceil(order.length / PAGE) - 1);
    page = Math.min(Math.max(page, 0), last);
    by("found").textContent = `${order.length} of ${data.rows} object-frames`;
    by("where").textContent = `Page ${page + 1} of ${last + 1}`;
    by("back").disabled = page === 0;
    by("next").disabled = page === last;
    for (const cell of head.children) {
      if (!cell.dataset.name) continue;
      cell.setAttribute("aria-sort", cell.dataset.name !== sorted.name ? "none" : sorted.down ? "descending" : "ascending");
    }
    body.replaceChildren(...order.slice(page * PAGE, (page + 1) * PAGE).map(line));
  }

  function line(row) {
    const element = document.createElement("tr");
    const button = make("button", columns.picture[row] ? "picture" : "command", make("td", "", element));
    button.type = "button";
    button.addEventListener("click", () => open(row));
    for (const [name, , digits] of SHOWN) make("td", shown(name, digits, row), element, digits === null ? "" : "number");
    return element;
  }

  function open(row) {
    const parts = [word("object_class", row), word("track_id", row), "in", word("recording", row), "camera", word("camera", row)];
    by("viewer-title").textContent = `${parts.join(" ")}, ${columns.time_s[row].toFixed(2)} s`;
    const coverage = columns.coverage[row];
    const summary = coverage === null ? word("outcome", row) : `${word("category", row)}, ${coverage.toFixed(1)} % found, IoU ${columns.iou[row].toFixed(1)} %`;
    const content = by("viewer-body");
    content.replaceChildren(make("p", summary));
    if (columns.picture[row]) {
      const card = by(columns.picture[row]);
      const own = [...card.querySelectorAll("[data-object]")].some((image) => image.dataset.object === word("track_id", row));
      if (own) content.append(card.querySelector(".facts").cloneNode(true));
      for (const image of card.querySelectorAll("img")) {
        if (!image.dataset.object || image.dataset.object === word("track_id", row)) content.append(image.cloneNode());
      }
    } else {
      make("p", "This page holds no picture of this image. This draws it:", content);
    }
    const call = ["recording", "camera"].reduce((text, name) => text.replace(`{${name}}`, () => quoted(word(name, row))), data.command);
    make("pre", call.replace("{index}", () => columns.index[row]), content);
    by("viewer").showModal();
  }

  function quoted(text) { return /^[\w@%+=:,./-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\"'\"'")}'`; }

  make("th", "picture", head).scope = "col";
  for (const [name, heading, digits] of SHOWN) {
    const cell = make("th", "", head, digits === null ? "" : "number");
    cell.scope = "col";
    cell.dataset.name = name;
    const button = make("button", heading, cell);
    button.type = "button";
    button.addEventListener("click", () => {
      sorted = { name, down: sorted.name === name && !sorted.down };
      order.sort(compare);
      page = 0;
      draw();
    });
  }
  for (const select of filters) {
    select.append(new Option("any", ""));
    words[select.dataset.filter].forEach((text, index) => select.append(new Option(text || "unknown", index)));
    select.addEventListener("change", refresh);
  }
  const evaluated = words.outcome.indexOf("evaluated");
  const outcome = document.querySelector("[data-filter=outcome]");
  if (evaluated >= 0) outcome.value = String(evaluated);
  by("search").addEventListener("input", refresh);
  by("pictured").addEventListener("change", refresh);
  by("filters").addEventListener("submit", (event) => event.preventDefault());
  by("filters").addEventListener("reset", () => setTimeout(refresh));
  by("back").addEventListener("click", () => { page -= 1; draw(); });
  by("next").addEventListener("click", () => { page += 1; draw(); });
  for (const link of document.querySelectorAll("#recordings tbody th a")) {
    link.addEventListener("click", () => {
      const select = document.querySelector("[data-filter=recording]");
      select.value = String(words.recording.indexOf(link.textContent));
      refresh();
    });
  }
  for (const image of document.querySelectorAll(".card .pictures img, .pairs img")) {
    image.addEventListener("click", () => {
      by("viewer-title").textContent = image.alt;
      by("viewer-body").replaceChildren(image.cloneNode());
      by("viewer").showModal();
    });
  }
  // Sections are open in the file, so that nothing is lost without scripts, and folded on a phone.
  const phone = matchMedia("(max-width: 40rem)");
  function fold() { for (const part of document.querySelectorAll(".part")) part.open = !phone.matches; }
  function reveal(hash) {
    const part = by(decodeURIComponent(hash.slice(1)))?.closest("section")?.querySelector(".part");
    if (part) part.open = true;
  }
  phone.addEventListener("change", fold);
  addEventListener("click", (event) => { const link = event.target.closest("a[href^='#']"); if (link) reveal(link.hash); });
  addEventListener("beforeprint", () => { for (const part of document.querySelectorAll("section > details, .part > details")) part.open = true; });
  addEventListener("afterprint", fold);
  fold();
  reveal(location.hash);
  refresh();
})();

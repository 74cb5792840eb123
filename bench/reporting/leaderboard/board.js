"use strict";
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const by = (id) => document.getElementById(id);
  const MARKS = { oracle: "oracle, no method", ceiling: "ceiling, no method", method: "" };
  const LOWER = new Set(["false_positive_coverage", "cost"]);  // where less is better
  let sorted = { name: "iou", down: true };

  function make(tag, text, parent, className) {
    const element = document.createElement(tag);
    if (text) element.textContent = text;
    if (className) element.className = className;
    if (parent) parent.append(element);
    return element;
  }

  function percent(value) { return value === null || value === undefined ? "n/a" : (100 * value).toFixed(1); }

  function name(group) { return group.split ? `${group.dataset}, ${group.split}` : group.dataset; }

  function fill(select, options, wanted) {
    const before = wanted ?? select.value;
    select.replaceChildren(...options.map(([value, text]) => new Option(text, value)));
    if (options.some(([value]) => String(value) === String(before))) select.value = before;
  }

  // Groups of one data set and protocol differ in their reference; each is a choice of its own.
  function groupsOf(dataset) { return data.groups.map((group, index) => [index, group]).filter(([, group]) => name(group) === dataset); }

  function chooseDataset() {
    const found = groupsOf(by("dataset").value);
    const names = found.map(([, group]) => group.protocol);
    fill(by("protocol"), found.map(([index, group]) => [index, names.filter((n) => n === group.protocol).length > 1
      ? `${group.protocol}, reference ${group.reference_digest.slice(0, 8)}` : group.protocol]));
    chooseGroup();
    choosePair();
  }

  function current() { return data.groups[Number(by("protocol").value)]; }

  function chooseGroup() {
    fill(by("row"), current().rows.map((row) => [row.name, row.label]));
    drawTable();
  }

  function valueOf(entry, row, metric) {
    if (metric === "cost") return entry.cost_ms;
    if (metric === "method") return entry.method.toLowerCase();
    return entry.values[row][metric][0];
  }

  function compare(row) {
    return (one, other) => {
      const left = valueOf(one, row, sorted.name), right = valueOf(other, row, sorted.name);
      if (left === right) return one.run < other.run ? -1 : 1;
      if (left === null) return 1;
      if (right === null) return -1;
      return (left < right ? -1 : 1) * (sorted.down ? -1 : 1);
    };
  }

  function drawTable() {
    const group = current(), row = group.rows.find((one) => one.name === by("row").value);
    by("about").textContent = `${group.images} images that all scored, ${row.object_frames} object-frames in ${row.recordings} recordings; ` +
      `protocol ${group.protocol}${group.judged ? ", which judges" : ", carried along"}${group.annotations ? `; annotations: ${group.annotations}` : ""}.`;
    const columns = [["method", "method"], ...Object.entries(group.metrics), ["cost", "ms per image"]];
    by("board").tHead.rows[0].replaceChildren(...columns.map(([metric, heading]) => {
      const cell = make("th");
      cell.scope = "col";
      cell.setAttribute("aria-sort", sorted.name !== metric ? "none" : sorted.down ? "descending" : "ascending");
      const button = make("button", heading, cell);
      button.type = "button";
      button.addEventListener("click", () => {
        sorted = { name: metric, down: sorted.name === metric ? !sorted.down : !LOWER.has(metric) && metric !== "method" };
        drawTable();
      });
      if (row.ceiling[metric] !== undefined) make("small", `${LOWER.has(metric) ? "exact masks" : "ceiling"} ${percent(row.ceiling[metric])}`, cell);
      if (metric === "false_positive_coverage") make("small", "of the image, all rows", cell);
      if (metric === "segmentation_iou") make("small", "of all images, all rows", cell);
      return cell;
    }));
    const entries = group.entries.filter((entry) => entry.kind === "method" || by("oracles").checked);
    const methods = group.entries.filter((entry) => entry.kind === "method");
    by("board").tBodies[0].replaceChildren(...entries.sort(compare(row.name)).map((entry) => {
      const line = make("tr", "", null, entry.kind === "method" ? (entry === methods[0] ? "best" : "") : "bound");
      const head = make("th", "", line);
      head.scope = "row";
      const page = group.pages[entry.run];
      if (page) make("a", entry.method, head).href = page; else head.append(entry.method);
      if (MARKS[entry.kind]) make("small", MARKS[entry.kind], head);
      if (entry.verified) make("small", "verified", head);
      if (entry.failures) make("small", `${entry.failures} failures`, head);
      for (const metric of Object.keys(group.metrics)) value(entry, row, metric, labelled(line, group.metrics[metric]));
      const cost = labelled(line, "ms per image");
      cost.append(entry.cost_ms === null ? "" : entry.cost_ms.toFixed(1));
      return line;
    }));
  }

  // On a phone a row is a block whose cells name their columns.
  function labelled(line, heading) {
    const cell = make("td", "", line);
    cell.dataset.heading = heading;
    return cell;
  }

  function value(entry, row, metric, cell) {
    const [found, low, high] = entry.values[row.name][metric];
    const ceiling = row.ceiling[metric];
    if (found === null) { cell.textContent = "n/a"; return; }
    if (!metric.startsWith("chance")) {
      const meter = make("span", "", cell, "meter");
      meter.setAttribute("aria-hidden", "true");
      meter.style.setProperty("--v", `${100 * found}%`);
      make("i", "", meter);
      if (low !== undefined) {
        const span = make("b", "", meter);
        span.style.setProperty("--l", `${100 * low}%`);
        span.style.width = `${100 * (high - low)}%`;
      }
      if (ceiling !== undefined) make("u", "", meter).style.left = `${100 * ceiling}%`;
    }
    make("strong", percent(found), cell);
    if (ceiling !== undefined && entry.kind === "method" && metric.includes("iou")) { cell.append(" "); make("small", `of ${percent(ceiling)}`, cell, "of"); }
    if (low !== undefined) make("small", `${percent(low)} to ${percent(high)}`, cell);
  }

  function choosePair() {
    if (!by("pictures")) return;
    const [, group] = groupsOf(by("dataset").value).find(([, one]) => one.judged) ?? [];
    const examples = group ? data.examples[group.dataset] ?? [] : [];
    const drawn = group ? group.entries.filter((entry) => examples.some((example) => example.layers[entry.run])) : [];
    const options = drawn.map((entry) => [entry.run, entry.kind === "method" ? entry.method : `${entry.method} (${entry.kind})`]);
    const methods = drawn.filter((entry) => entry.kind === "method");
    const papers = methods.find((entry) => /^spherical( \(flow=farneback\))?$/.test(entry.method)) ?? methods[1];
    const best = methods.find((entry) => entry !== papers);
    fill(by("left"), options, papers && papers.run);
    fill(by("right"), options, best && best.run);
    drawPair();
  }

  function drawPair() {
    const [, group] = groupsOf(by("dataset").value).find(([, one]) => one.judged) ?? [];
    const examples = group ? data.examples[group.dataset] ?? [] : [];
    by("examples").replaceChildren(...(examples.length ? examples.map(example) : [make("p", "No pictures of this data set.", null, "absent")]));
  }

  function example(found) {
    const part = make("div", "", null, "example");
    make("h3", found.title, part);
    const two = make("div", "", part, "two");
    for (const select of [by("left"), by("right")]) {
      const figure = make("figure", "", two), stack = make("span", "", figure, "stack");
      const label = select.selectedOptions.length ? select.selectedOptions[0].text : "";
      const photograph = make("img", "", stack);
      photograph.src = found.image;
      photograph.alt = `Camera image with what ${label} marks: ${found.notes[select.value] ?? "not scored"}`;
      if (found.layers[select.value]) { const layer = make("img", "", stack); layer.src = found.layers[select.value]; layer.alt = ""; }
      make("figcaption", `${label}: ${found.notes[select.value] ?? "did not score this image"}`, figure);
    }
    return part;
  }

  if (!data.groups.length) return;
  fill(by("dataset"), [...new Set(data.groups.map(name))].map((text) => [text, text]));
  by("dataset").addEventListener("change", chooseDataset);
  by("protocol").addEventListener("change", chooseGroup);
  by("row").addEventListener("change", drawTable);
  by("oracles").addEventListener("change", drawTable);
  for (const id of ["left", "right"]) by(id)?.addEventListener("change", drawPair);
  for (const form of document.querySelectorAll("form")) form.addEventListener("submit", (event) => event.preventDefault());
  chooseDataset();
})();

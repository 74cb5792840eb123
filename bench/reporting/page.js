"use strict";
// One script for all pages: headings sort, choices filter, long tables unfold, sections fold, pictures enlarge.
(() => {
  const FIRST = 50; // rows of a table that are shown at first
  const all = (selector, within = document) => [...within.querySelectorAll(selector)];
  const form = document.getElementById("filters"), selects = all("#filters select"), search = form?.querySelector("input");
  const tags = selects.map((select) => `[data-${select.dataset.filter}]`).join(", ");
  const tagged = tags ? all(tags).filter((element) => element.matches("tr, .group")) : [];
  const tables = all(".scroll").filter((part) => part.querySelector("tbody"));

  function words(cell) { return [...cell.childNodes].filter((node) => node.nodeName !== "SMALL").map((node) => node.textContent).join("").trim(); }

  function number(cell) { return parseFloat(words(cell).replace(/^[<>+,]+/, "").replaceAll(",", "")); }

  // Empty cells and "n/a" come last both ways.
  function sort(table, place, down) {
    const rows = all("tbody tr", table).map((row) => ({ row, text: words(row.cells[place]), value: number(row.cells[place]) }));
    const numbers = rows.every(({ text, value }) => !text || text === "n/a" || !Number.isNaN(value));
    const key = numbers ? ({ value }) => value : ({ text }) => text.toLowerCase();
    const [empty, full] = [rows.filter((one) => !one.text || one.text === "n/a"), rows.filter((one) => one.text && one.text !== "n/a")];
    full.sort((a, b) => (key(a) < key(b) ? -1 : key(a) > key(b) ? 1 : 0) * (down ? -1 : 1));
    table.tBodies[0].append(...[...full, ...empty].map(({ row }) => row));
  }

  function press(table, heading) {
    const down = heading.getAttribute("aria-sort") === "ascending";
    for (const other of heading.parentNode.cells) other.setAttribute("aria-sort", "none");
    heading.setAttribute("aria-sort", down ? "descending" : "ascending");
    sort(table, heading.cellIndex, down);
    limit(table.closest(".scroll"));
  }

  for (const part of tables) {
    const table = part.querySelector("table");
    if (table.rows.length < 4 || table.matches(".tiles, .about")) continue;
    for (const heading of table.tHead?.rows[0].cells ?? []) {
      const button = document.createElement("button");
      button.type = "button";
      button.append(...heading.childNodes);
      button.addEventListener("click", () => press(table, heading));
      if (button.textContent) heading.append(button);
    }
  }

  function limit(part) {
    const rows = all("tbody tr", part).filter((row) => !row.hidden), most = Number(part.dataset.most ?? FIRST);
    rows.forEach((row, place) => row.classList.toggle("beyond", place >= most));
    part.hidden = !rows.length;
    part.nextElementSibling?.matches(".more") && part.nextElementSibling.remove();
    if (rows.length <= most) return;
    const more = document.createElement("button");
    more.className = "more";
    more.textContent = `Show more: ${most} of ${rows.length} rows`;
    more.addEventListener("click", () => { part.dataset.most = 4 * most; limit(part); });
    part.after(more);
  }

  function refresh() {
    const chosen = {}, asked = (search?.value ?? "").toLowerCase().split(/\s+/).filter(Boolean);
    for (const select of selects) if (select.value) (chosen[select.dataset.filter] ??= []).push(select.value);
    for (const element of tagged) {
      const found = element.tagName !== "TR" || asked.every((part) => element.textContent.toLowerCase().includes(part));
      element.hidden = !found || Object.entries(chosen).some(([tag, values]) => !values.includes(element.dataset[tag] ?? values[0]));
    }
    tables.forEach(limit);
    const rows = tagged.filter((element) => element.tagName === "TR");
    if (form && rows.length) form.querySelector("output").textContent = `${rows.filter((row) => !row.hidden).length} of ${rows.length} rows`;
  }

  for (const select of selects) {
    const values = [...new Set(tagged.map((element) => element.dataset[select.dataset.filter]).filter(Boolean))];
    select.append(...values.map((value) => new Option(value, value, value === select.dataset.chosen, value === select.dataset.chosen)));
    if (select.selectedIndex < 0) select.value = "";
    select.parentNode.hidden = values.length < 2;
    select.addEventListener("change", refresh);
  }
  search?.addEventListener("input", refresh);
  form?.addEventListener("submit", (event) => event.preventDefault());
  form?.addEventListener("reset", () => setTimeout(refresh));

  // A link leads to an element, or, as "#recording=drive-1", to the rows of a choice.
  function follow() {
    const [name, value] = decodeURIComponent(location.hash.slice(1)).split("=");
    const select = value && selects.find((one) => one.dataset.filter === name);
    if (select) { select.value = value; refresh(); }
    const target = select ? form : document.getElementById(name);
    for (let part = target; part; part = part.parentElement) if (part.matches("details")) part.open = true;
    const part = target?.querySelector(":scope > details.part");
    if (part) part.open = true;
    target?.scrollIntoView();
  }
  addEventListener("hashchange", follow);
  addEventListener("click", (event) => { if (event.target.closest("a[href^='#']")?.hash === location.hash) follow(); });

  const viewer = document.getElementById("viewer");
  for (const image of all("figure img")) {
    image.addEventListener("click", () => {
      viewer.querySelector("h2").textContent = image.alt;
      viewer.querySelector("div").replaceChildren(image.cloneNode());
      viewer.showModal();
    });
  }

  // Sections are open in the file, so that nothing is lost without scripts, and folded on a phone.
  const phone = matchMedia("(max-width: 40rem)");
  function fold() { for (const part of all(".part")) part.open = !phone.matches || part.parentNode.matches("section:first-of-type"); }
  phone.addEventListener("change", fold);
  addEventListener("beforeprint", () => { for (const part of all(".part")) part.open = true; });
  addEventListener("afterprint", fold);
  fold();
  refresh();
  if (location.hash) follow();
})();

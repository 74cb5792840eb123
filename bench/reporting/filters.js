"use strict";
// Each filter hides the rows and pictures whose tag of its name is another; what has no such tag stays.
(() => {
  const form = document.getElementById("filters");
  const selects = [...form.querySelectorAll("select")];
  const tagged = [...document.querySelectorAll(selects.map((select) => `[data-${select.dataset.filter}]`).join(", "))]
    .filter((element) => element.matches("tr, figure"));

  function refresh() {
    const chosen = selects.filter((select) => select.value !== "").map((select) => [select.dataset.filter, select.value]);
    for (const element of tagged) {
      element.hidden = chosen.some(([name, value]) => (element.dataset[name] ?? value) !== value);
    }
    for (const table of document.querySelectorAll(".scroll")) table.hidden = !table.querySelector("tbody tr:not([hidden])");
    const shown = tagged.filter((element) => !element.hidden).length;
    form.querySelector("output").textContent = `${shown} of ${tagged.length} rows and pictures`;
  }

  for (const select of selects) {
    const values = new Set(tagged.map((element) => element.dataset[select.dataset.filter]).filter(Boolean));
    select.append(...[...values].map((value) => new Option(value, value)));
    select.addEventListener("change", refresh);
  }
  form.addEventListener("submit", (event) => event.preventDefault());
  form.addEventListener("reset", () => setTimeout(refresh));
  refresh();
})();

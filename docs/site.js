// What the theme's own script adds to a page while it loads, made usable by keyboard and by name: wide tables and code
// scroll, and every block of code has a group of buttons.
const complete = () => {
  document.querySelectorAll(".md-typeset__scrollwrap, pre > code").forEach((scrolled) => (scrolled.tabIndex = 0));
  document.querySelectorAll(".md-code__nav").forEach((buttons, number) => (buttons.ariaLabel = `Code ${number + 1}`));
};
new MutationObserver(complete).observe(document.body, { childList: true, subtree: true });
complete();

// Browsers refuse the search its index from disk: show no search there.
if (location.protocol === "file:") document.querySelectorAll(".md-search, [for=__search]").forEach((part) => (part.style.display = "none"));

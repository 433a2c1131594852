// Each cell of a table gets the title of its column, so that a phone can show a row as a card. Tables take the keyboard.
"use strict";
for (const table of document.querySelectorAll(".md-typeset table:not([class])")) {
  const titles = [...table.querySelectorAll("thead th")].map(head => head.textContent.trim());
  const rows = [...table.querySelectorAll("tbody tr")];
  if (titles.length > 1 && rows.every(row => row.cells.length === titles.length)) {
    for (const row of rows) [...row.cells].forEach((cell, k) => { cell.dataset.label = titles[k]; });
    table.dataset.cards = "";
  }
}
for (const box of document.querySelectorAll(".md-typeset__table")) {
  box.tabIndex = 0;
  box.setAttribute("role", "region");
  box.setAttribute("aria-label", "table, scrolls sideways");
}
// The theme's search is a dialog without a name.
document.querySelector(".md-search")?.setAttribute("aria-label", "Search");

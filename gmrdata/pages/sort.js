// A click on a heading sorts its table by that column; a second click turns the order round.
for (const button of document.querySelectorAll("thead button")) {
  button.addEventListener("click", () => {
    const heading = button.closest("th"), table = button.closest("table");
    const column = [...heading.parentNode.children].indexOf(heading);
    const down = heading.getAttribute("aria-sort") === "ascending";
    const value = row => {
      const cell = row.children[column], marked = cell.querySelector("[data-sort]");
      return marked ? marked.dataset.sort : cell.textContent;
    };
    const compare = (a, b) => a.localeCompare(b, "en", { numeric: true });
    const number = (a, b) => Number(a) - Number(b);
    const rows = [...table.tBodies[0].rows];
    const numeric = rows.every(row => value(row) !== "" && !Number.isNaN(Number(value(row))));
    rows.sort((a, b) => (numeric ? number : compare)(value(a), value(b)) * (down ? -1 : 1));
    for (const other of heading.parentNode.children) other.removeAttribute("aria-sort");
    heading.setAttribute("aria-sort", down ? "descending" : "ascending");
    table.tBodies[0].append(...rows);
  });
}

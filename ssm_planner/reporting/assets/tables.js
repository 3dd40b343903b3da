// Sort tables by a column, save the plotted data as CSV, and let times in tables move the time slider.
"use strict";
// Let a click on a heading of a table sort its rows, and a second click reverse the order.
SSM.sortable = (table) => {
  const headings = [...table.tHead.rows[0].cells];
  const value = (row, i) => {
    const cell = row.cells[i];
    return "value" in cell.dataset ? Number(cell.dataset.value) : cell.textContent.trim().toLowerCase();
  };
  const compare = (a, b) => a - b || String(a).localeCompare(b);
  headings.forEach((heading, i) => {
    heading.querySelector("button")?.addEventListener("click", () => {
      const isAscending = heading.getAttribute("aria-sort") !== "ascending";
      headings.forEach((other) => other.removeAttribute("aria-sort"));
      heading.setAttribute("aria-sort", isAscending ? "ascending" : "descending");
      const rows = [...table.tBodies[0].rows];
      rows.sort((a, b) => (isAscending ? 1 : -1) * compare(value(a, i), value(b, i)));
      table.tBodies[0].append(...rows);
    });
  });
};

// Return everything that is plotted as CSV, in the units of the plots.
SSM.csv = (data, channels) => {
  const columns = [["time (s)", channels.t, 1], ...data.panels.flatMap(({ title, unit, scale, series }) =>
    series.map(({ channel, label }) => [`"${title}, ${label} (${unit})"`, channels[channel], scale]))];
  const rows = [...channels.t].map((_, i) => columns.map(([, values, scale]) => Number((values[i] * scale).toPrecision(9))).join());
  return [columns.map(([name]) => name), ...rows].join("\n");
};

// Let each button with a time set the player to this time.
SSM.linkTimeButtons = (player) => {
  for (const button of document.querySelectorAll("button.moment")) {
    button.addEventListener("click", () => player.at(Number(button.dataset.time)));
  }
};

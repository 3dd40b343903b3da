// Tables: sorting by a column, and times that move the scrubber.
"use strict";
SSM.sortable = (table) => {
  const heads = [...table.tHead.rows[0].cells];
  const value = (row, i) => {
    const cell = row.cells[i];
    return "value" in cell.dataset ? Number(cell.dataset.value) : cell.textContent.trim().toLowerCase();
  };
  const compare = (a, b) => a - b || String(a).localeCompare(b);
  heads.forEach((head, i) => {
    head.querySelector("button")?.addEventListener("click", () => {
      const rising = head.getAttribute("aria-sort") !== "ascending";
      heads.forEach((other) => other.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", rising ? "ascending" : "descending");
      const rows = [...table.tBodies[0].rows];
      rows.sort((a, b) => (rising ? 1 : -1) * compare(value(a, i), value(b, i)));
      table.tBodies[0].append(...rows);
    });
  });
};

// everything plotted, in the units of the plots, as CSV
SSM.csv = (data, channels) => {
  const columns = [["time (s)", channels.t, 1], ...data.panels.flatMap(({ title, unit, scale, series }) =>
    series.map(({ channel, label }) => [`"${title}, ${label} (${unit})"`, channels[channel], scale]))];
  const rows = [...channels.t].map((_, i) => columns.map(([, values, scale]) => Number((values[i] * scale).toPrecision(9))).join());
  return [columns.map(([name]) => name), ...rows].join("\n");
};

SSM.moments = (player) => {
  for (const button of document.querySelectorAll("button.moment")) {
    button.addEventListener("click", () => player.at(Number(button.dataset.time)));
  }
};

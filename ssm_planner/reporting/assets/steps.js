// Replace the list of changes of a limit by a slider that shows one of them. Without JavaScript, the page shows the whole list.
"use strict";
(() => {
  const rows = [...document.querySelectorAll("#changes li")];
  const range = document.getElementById("step");
  const show = () => rows.forEach((row, i) => { row.hidden = i !== Number(range.value); });
  range.hidden = false;
  range.addEventListener("input", show);
  show();
})();

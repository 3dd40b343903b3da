// A slider over the changes of a limit, of which the page lists all while there is no script.
"use strict";
(() => {
  const rows = [...document.querySelectorAll("#changes li")];
  const range = document.getElementById("step");
  const show = () => rows.forEach((row, i) => { row.hidden = i !== Number(range.value); });
  range.hidden = false;
  range.addEventListener("input", show);
  show();
})();

// The tree of squeezes: nested panels. `details` shows the chosen one, and what `about(key, byHand)` says of it.
// It stands beside the tree; on a narrow screen below the chosen panel, unless the tree scrolls in a box.
function treeView(plan, details, about) {
  const aside = details.parentElement, narrow = matchMedia("(max-width: 800px)");
  let chosen = null;
  function choose(key, focus = false) {
    const panel = byId(key);
    if (!panel?.classList.contains("panel")) return;
    for (let fold = panel.closest("details"); plan.contains(fold); fold = fold.parentElement.closest("details")) fold.open = true;
    chosen?.removeAttribute("aria-pressed");
    chosen = panel;
    panel.setAttribute("aria-pressed", "true");
    details.replaceChildren(panel.querySelector("svg").cloneNode(true), about(key, focus));
    if (narrow.matches && !plan.classList.contains("boxed")) panel.after(details);
    else aside.append(details);
    if (focus) panel.focus({preventScroll: true});
  }
  const reveal = key => { choose(key, true); byId(key)?.scrollIntoView({block: "nearest"}); };
  // Marks the panels on the way of a part, and the branches that lead to them.
  function mark(keys) {
    for (const old of plan.querySelectorAll(".taken")) old.classList.remove("taken");
    for (const key of keys) for (const id of [key, `to-${key}`]) byId(id)?.classList.add("taken");
  }
  document.addEventListener("click", event => {
    const button = event.target.closest(".panel, [data-to]");
    if (button?.dataset.to) reveal(button.dataset.to);
    else if (button) choose(button.id, true);
  });
  plan.addEventListener("keydown", event => {
    const panel = event.target.closest(".panel"), item = panel?.parentElement;
    if (!item) return;
    const seen = [...plan.querySelectorAll(".panel")].filter(other => other.checkVisibility()), at = seen.indexOf(panel);
    const moves = {ArrowUp: seen[at - 1], ArrowDown: seen[at + 1], ArrowLeft: item.parentElement.closest("li:not(.light)")?.querySelector(".panel"), ArrowRight: item.querySelector(":scope > ol .panel"), Home: seen[0]};
    if (!(event.key in moves)) return;
    event.preventDefault();
    if (moves[event.key]) reveal(moves[event.key].id);
  });
  return {choose, reveal, mark};
}
// Marks the width that was read in the chart of the widths from `low` to `high`.
function pointAt(details, width, {low, high}) {
  const x = Math.min(Math.max(100 * (width - low) / (high - low), 0), 100);
  details.querySelector(".chart svg")?.append(shape("polyline", {class: "mark", points: `${x},0 ${x},100`}));
}

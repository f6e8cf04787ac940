const data = JSON.parse(byId("data").textContent), plan = byId("plan"), details = byId("details"), aside = byId("aside");
const narrow = matchMedia("(max-width: 800px)"), spoken = key => key.replace("-", " ");
let chosen = null;

// Choosing a panel: what there is to say of it stands beside the tree, on a narrow screen below the panel.
function choose(key, focus = false) {
  const panel = byId(key);
  if (!panel?.classList.contains("panel")) return;
  for (let fold = panel.closest("details"); fold; fold = fold.parentElement.closest("details")) fold.open = true;
  chosen?.removeAttribute("aria-pressed");
  chosen = panel;
  panel.setAttribute("aria-pressed", "true");
  details.replaceChildren(panel.querySelector("svg").cloneNode(true), byId(`about-${key}`).content.cloneNode(true));
  if (narrow.matches) panel.after(details);
  else aside.append(details);
  if (focus) panel.focus({preventScroll: true});
}
const reveal = key => { choose(key, true); byId(key)?.scrollIntoView({block: "nearest"}); };
document.addEventListener("click", event => {
  const button = event.target.closest(".panel, [data-to]");
  if (button?.dataset.to) reveal(button.dataset.to);
  else if (button) choose(button.id, true);
});
plan.addEventListener("keydown", event => {
  const panel = event.target.closest(".panel"), item = panel?.parentElement;
  if (!item) return;
  const seen = [...plan.querySelectorAll(".panel")].filter(other => other.checkVisibility()), at = seen.indexOf(panel);
  const moves = {ArrowUp: seen[at - 1], ArrowDown: seen[at + 1], ArrowLeft: item.parentElement.closest("li:not(.light)")?.querySelector(".panel"), ArrowRight: item.querySelector("ol .panel"), Home: seen[0]};
  if (!(event.key in moves)) return;
  event.preventDefault();
  if (moves[event.key]) reveal(moves[event.key].id);
});
addEventListener("hashchange", () => reveal(location.hash.slice(1)));

// The way of a part: what is taken is marked.
function mark(keys) {
  for (const old of document.querySelectorAll(".taken")) old.classList.remove("taken");
  for (const key of keys) for (const id of [key, `to-${key}`]) byId(id)?.classList.add("taken");
}
function follow(widths) {
  const keys = ["node-0"];
  byId("said").textContent = "";
  for (const width of widths) {
    const off = ({low_mm, high_mm}) => Math.max(low_mm - width, width - high_mm, 0);
    const [next] = [...data.nodes[keys.at(-1)]?.ways ?? []].sort((one, other) => off(one) - off(other));
    if (!next) break;
    if (off(next) > 0.06) { byId("said").textContent = `${spoken(keys.at(-1))} rejects ${width} mm`; break; }
    keys.push(next.to);
  }
  mark(keys);
  reveal(keys.at(-1));
}
byId("goto").addEventListener("change", event => {
  const text = event.target.value.trim(), widths = text.split(/[\s,;]+/).map(Number), key = /^(node|leaf)?\D*(\d+)$/i.exec(text);
  if (/[\s,;.]/.test(text) && widths.every(width => width > 0)) follow(widths);
  else if (key) reveal(`${(key[1] ?? "node").toLowerCase()}-${key[2]}`);
});

// The journal: one part at a time.
let part = null, step = 0;
function pointAt({node, width_mm}) {
  const {low, high} = data.nodes[node].span_mm, x = Math.min(Math.max(100 * (width_mm - low) / (high - low), 0), 100);
  details.querySelector(".chart svg")?.append(shape("polyline", {class: "mark", points: `${x},0 ${x},100`}));
}
function sentence() {
  if (!part) return byId("log-failed").checked ? "No part failed." : "No parts.";
  const {squeezes, outcome, name, audit, reason} = part, last = squeezes[step - 1];
  const begun = squeezes.length ? `${squeezes.length} squeezes; it stands at ${spoken(squeezes[0].node)}.` : "it was never squeezed.";
  const text = last ? `squeeze ${step}: ${spoken(last.node)} read ${last.width_mm.toFixed(2)} mm \u2192 ${last.to ? spoken(last.to) : "REJECT"}.` : `before the first squeeze: ${begun}`;
  const end = step < squeezes.length ? "" : ` Outcome: ${outcome}${name ? `, ${name}` : ""}${audit ? `, audit ${audit}` : ""}${reason ? `: ${reason}` : ""}.`;
  return `Part ${part.part}, ${text}${end}`;
}
function show() {
  const squeezes = part?.squeezes ?? [], last = squeezes[step - 1];
  byId("log-back").disabled = step === 0;
  byId("log-next").disabled = step >= squeezes.length;
  byId("log-step").textContent = sentence();
  mark([...squeezes.slice(0, step + 1).map(each => each.node), ...last?.to ? [last.to] : []]);
  if (!last) return;
  choose(last.node);
  pointAt(last);
}
function take(index) { part = data.parts[index] ?? null; step = 0; show(); }
function list() {
  const shown = data.parts.map((each, index) => ({each, index})).filter(({each}) => each.failed || !byId("log-failed").checked);
  byId("log-part").replaceChildren(...shown.map(({each, index}) => make("option", {value: index}, [`${each.part}: ${each.outcome}`, each.name, each.audit && `audit ${each.audit}`].filter(Boolean).join(", "))));
  take(shown[0]?.index);
}
choose("node-0");
if (data.parts) {
  byId("log-part").addEventListener("change", event => take(Number(event.target.value)));
  byId("log-failed").addEventListener("change", list);
  byId("log-back").addEventListener("click", () => { step -= 1; show(); });
  byId("log-next").addEventListener("click", () => { step += 1; show(); });
  list();
}
if (location.hash.length > 1) reveal(location.hash.slice(1));

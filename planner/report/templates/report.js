const data = JSON.parse(byId("data").textContent), details = byId("details"), spoken = key => key.replace("-", " ");
const {choose, reveal, mark} = treeView(byId("plan"), details, key => byId(`about-${key}`).content.cloneNode(true));
addEventListener("hashchange", () => reveal(location.hash.slice(1)));

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
  pointAt(details, last.width_mm, data.nodes[last.node].span_mm);
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

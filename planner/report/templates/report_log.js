// The journal: how many went where, and one part at a time.
const log = data.log, partList = document.getElementById("log-part"), onlyFailed = document.getElementById("log-failed");
const failed = ([, outcome, , , audit]) => outcome !== "leaf" || audit === "fail";
for (const [index, node] of data.nodes.entries()) {
  const total = [...node.branches.map(branch => branch[4]), null].reduce((sum, target) => sum + logged(index, target), 0);
  for (const [, , , ppm, target] of node.branches) {
    const seen = logged(index, target);
    document.getElementById(`share-${keyOf(target)}`).textContent = seen ? `${seen}\u00d7` : "\u2013";
    const line = document.getElementById(`to-${keyOf(target)}`);
    line.setAttribute("stroke-width", 0.8 + (log.total ? 3 * seen / log.total : 0));
    line.append(shape("title", {}, `${seen} of ${total} here; ${(total * ppm / 1e6).toFixed(1)} were to be expected`));
  }
}
const told = Object.entries(log.outcomes).map(([outcome, number]) => `${number} ${outcome}`).join(", ");
const notes = [`${log.total} parts in ${log.runs} ${log.runs === 1 ? "run" : "runs"}, ${log.first} to ${log.last}: ${told || "no outcome"}.`];
if (log.others) notes.push(`${log.others} runs of other tables in the same journal are left out.`);
if (log.parts.length < log.total) notes.push(`The list below holds ${log.parts.length} of them, those that failed first.`);
document.getElementById("log-figures").append(...notes.map(text => make("p", {}, text)));

if (log.rejects.length) {
  const drawn = log.rejects.map(([number, node, count, told]) => {
    const at = data.nodes[node], width = widthAt(count);
    const picture = scene(Math.max(data.reach, width / 2 + data.jaws[2]), at.belief, `Part ${number}: where it was believed, and the fingers as they stopped`, hand(at.place, width, "read"));
    return make("figure", {}, picture, make("figcaption", {}, `Part ${number}, node ${node}, count ${count}: ${told}`));
  });
  document.getElementById("rejects").append(make("h3", {}, "Rejects"), make("div", {class: "rejects"}, ...drawn));
}
let part = null, step = 0;
function fill() {
  const shown = log.parts.map((entry, index) => [entry, index]).filter(([entry]) => !onlyFailed.checked || failed(entry));
  partList.replaceChildren(...shown.map(([entry, index]) => make("option", {value: index}, `${entry[0]}: ${entry[1]}${entry[6] ? `, ${entry[6]}` : ""}${entry[4] ? `, audit ${entry[4]}` : ""}`)));
  take(shown.length ? shown[0][1] : -1);
}
function take(index) { part = log.parts[index] ?? null; step = 0; show(); }
function show() {
  document.querySelectorAll(".taken:not(.swatch)").forEach(element => element.classList.remove("taken"));
  document.getElementById("log-back").disabled = !part || step === 0;
  document.getElementById("log-next").disabled = !part || step >= part[5].length;
  const text = document.getElementById("log-step");
  if (!part) { text.textContent = onlyFailed.checked ? "No part failed." : "No parts."; return; }
  const [number, outcome, , reason, audit, squeezes, name] = part;
  const mark = key => { for (const id of [key, `to-${key}`]) document.getElementById(id)?.classList.add("taken"); };
  squeezes.slice(0, step + 1).forEach(([node]) => mark(keyOf(node)));
  const done = squeezes.slice(0, step), last = done.at(-1);
  if (last && last[2] !== null) mark(keyOf(last[2]));
  const begun = squeezes.length ? `${squeezes.length} squeezes; it stands at node ${squeezes[0][0]}.` : "it was never squeezed.";
  let sentence = `Part ${number}, before the first squeeze: ${begun}`;
  if (last) sentence = `Part ${number}, squeeze ${step}: node ${last[0]} read count ${last[1]} (${widthAt(last[1]).toFixed(2)} mm) \u2192 ${last[2] === null ? "REJECT" : nameOf(last[2])}.`;
  if (step === squeezes.length) sentence += ` Outcome: ${outcome}${name ? `, ${name}` : ""}${audit ? `, audit ${audit}` : ""}${reason ? `: ${reason}` : ""}.`;
  text.textContent = sentence;
  if (last) { choose(keyOf(last[0]), {show: true}); details.replaceChildren(...nodeDetails(last[0], last[1])); }
}
partList.addEventListener("change", () => take(Number(partList.value)));
onlyFailed.addEventListener("change", fill);
document.getElementById("log-back").addEventListener("click", () => { step -= 1; show(); });
document.getElementById("log-next").addEventListener("click", () => { step += 1; show(); });
fill();

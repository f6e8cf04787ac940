// Light branches folded away, and the others moved together: the same places as `layout.tidy` would give, in slots.
const least = document.getElementById("least"), shownText = document.getElementById("shown");
const SLOT = 70, PANEL = 64, MOST_SHOWN = 60;
const homes = new Map([...document.querySelectorAll("#plan .panel")].map(panel => {
  const {e: x, f: y} = panel.transform.baseVal.consolidate().matrix;
  return [panel.id, [x, y]];
}));
const ways = new Map([...parents.keys()].map(target => [keyOf(target), document.getElementById(`to-${keyOf(target)}`).getAttribute("d")]));
const shareOf = target => (target >= 0 ? data.nodes[target] : data.leaves[~target]).visits / data.trials;
const childrenOf = (target, share) => target < 0 ? [] : data.nodes[target].branches.map(branch => branch[4]).filter(child => shareOf(child) >= share);
function countFrom(share) {
  let number = 0;
  const waiting = [0];
  while (waiting.length) { const target = waiting.pop(); number += 1; waiting.push(...childrenOf(target, share)); }
  return number;
}
function placesFrom(share) {
  const places = new Map();
  let free = 8;
  (function settle(target) {
    const inner = childrenOf(target, share).map(settle);
    const x = inner.length ? (inner[0] + inner.at(-1)) / 2 : free;
    if (!inner.length) free += SLOT;
    places.set(keyOf(target), x);
    return x;
  })(0);
  return places;
}
function fold(share) {
  const places = share > 0 ? placesFrom(share) : new Map([...homes].map(([key, [x]]) => [key, x]));
  for (const [key, [home, y]] of homes) {
    const x = places.get(key), gone = x === undefined;
    for (const id of [key, `to-${key}`, `at-${key}`, `of-${key}`]) document.getElementById(id)?.classList.toggle("folded", gone);
    if (gone) continue;
    document.getElementById(key).setAttribute("transform", `translate(${x.toFixed(1)} ${y})`);
    for (const id of [`at-${key}`, `of-${key}`]) document.getElementById(id)?.setAttribute("transform", `translate(${(x - home).toFixed(1)} 0)`);
    const up = parents.get(targetOf(key));
    if (!up) continue;
    const from = places.get(keyOf(up[0])) + PANEL / 2, way = /^M\S+ (\S+)V(\S+)H\S+V(\S+)$/.exec(ways.get(key));
    document.getElementById(`to-${key}`).setAttribute("d", share > 0 ? `M${from.toFixed(1)} ${way[1]}V${way[2]}H${(x + PANEL / 2).toFixed(1)}V${way[3]}` : ways.get(key));
  }
  const folded = homes.size - places.size;
  shownText.textContent = folded ? `${places.size} of ${homes.size} panels; ${folded} lighter ones are folded away` : "";
  whole[2] = Math.max(...places.values()) + PANEL + 8;
  begin();
}
least.addEventListener("change", () => fold(Number(least.value)));
function unfold(key) {
  if (!document.getElementById(key).classList.contains("folded")) return;
  least.value = "0";
  fold(0);
}
// Widths from the root on, as a journal tells them: the last panel that they lead to.
function follow(widths) {
  document.querySelectorAll(".taken:not(.swatch)").forEach(element => element.classList.remove("taken"));
  let target = 0;
  const passed = [0];
  for (const width of widths) {
    if (target < 0) break;
    const count = [...Array(256).keys()].reduce((best, count) => Math.abs(widthAt(count) - width) < Math.abs(widthAt(best) - width) ? count : best, 0);
    const run = data.nodes[target].map.find(([first, last]) => first <= count && count <= last);
    if (!run) { shownText.textContent = `node ${target} rejects ${width} mm (count ${count})`; break; }
    target = data.nodes[target].branches[run[2]][4];
    passed.push(target);
  }
  unfold(keyOf(target));
  for (const at of passed) for (const id of [keyOf(at), `to-${keyOf(at)}`]) document.getElementById(id)?.classList.add("taken");
  choose(keyOf(target), {show: true});
}
const few = [...least.options].map(option => Number(option.value)).find(share => countFrom(share) <= MOST_SHOWN) ?? 0.1;
if (few > 0) { least.value = String(few); fold(few); }
choose(/^#(node|leaf)-\d+$/.test(location.hash) ? location.hash.slice(1) : "node-0", {show: location.hash.length > 1});

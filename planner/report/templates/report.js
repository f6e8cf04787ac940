"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const plan = document.getElementById("plan"), details = document.getElementById("details");
const parents = new Map();
data.nodes.forEach((node, index) => node.branches.forEach((branch, number) => parents.set(branch[4], [index, number])));
const keyOf = target => target >= 0 ? `node-${target}` : `leaf-${~target}`;
const targetOf = key => key.startsWith("node-") ? Number(key.slice(5)) : ~Number(key.slice(5));
const nameOf = target => target >= 0 ? `node ${target}` : `leaf ${~target}`;
const mm = um => (um / 1000).toFixed(2), degrees = urad => (urad / 1e6 * 180 / Math.PI).toFixed(1);
const percent = share => `${(100 * share).toFixed(share > 0 && share < 0.01 ? 2 : 1)} %`;
const across = um => 256 * um / data.opening;

// View: the part of the drawing that is seen.
const whole = plan.getAttribute("viewBox").split(" ").map(Number);
let view = [...whole];
function look(next) {
  const least = Math.min(80, whole[2]);
  const width = Math.min(Math.max(next[2], least), 1.5 * Math.max(whole[2], 600)), height = width * next[3] / next[2];
  view = [next[0], next[1], width, height];
  plan.setAttribute("viewBox", view.join(" "));
}
function zoom(factor, x = view[0] + view[2] / 2, y = view[1] + view[3] / 2) {
  look([x - (x - view[0]) * factor, y - (y - view[1]) * factor, view[2] * factor, view[3] * factor]);
}
function placeOf(event) {
  const place = new DOMPoint(event.clientX, event.clientY).matrixTransform(plan.getScreenCTM().inverse());
  return [place.x, place.y];
}
document.getElementById("in").addEventListener("click", () => zoom(1 / 1.4));
document.getElementById("out").addEventListener("click", () => zoom(1.4));
document.getElementById("fit").addEventListener("click", () => look([...whole]));
plan.addEventListener("wheel", event => {
  event.preventDefault();
  zoom(Math.exp(Math.max(-0.3, Math.min(0.3, event.deltaY / 400))), ...placeOf(event));
}, {passive: false});

const fingers = new Map();
let travelled = 0;
plan.addEventListener("pointerdown", event => { if (!fingers.size) travelled = 0; fingers.set(event.pointerId, event); });
plan.addEventListener("pointermove", event => {
  const before = fingers.get(event.pointerId);
  if (!before) return;
  const scale = plan.getScreenCTM().a, dx = event.clientX - before.clientX, dy = event.clientY - before.clientY;
  travelled += Math.hypot(dx, dy);
  if (travelled > 6 && !plan.hasPointerCapture(event.pointerId)) { plan.setPointerCapture(event.pointerId); plan.classList.add("moving"); }
  const other = [...fingers].find(([id]) => id !== event.pointerId);
  if (other) {
    const far = from => Math.hypot(from.clientX - other[1].clientX, from.clientY - other[1].clientY);
    zoom(Math.max(far(before), 1) / Math.max(far(event), 1), ...placeOf(event));
  } else if (travelled > 6) look([view[0] - dx / scale, view[1] - dy / scale, view[2], view[3]]);
  fingers.set(event.pointerId, event);
});
for (const end of ["pointerup", "pointercancel"]) plan.addEventListener(end, event => { fingers.delete(event.pointerId); plan.classList.remove("moving"); });

// Choosing a panel.
let chosen = null;
function choose(key, {focus = false, show = false} = {}) {
  const panel = document.getElementById(key);
  if (!panel) return;
  if (show) unfold(key);
  if (chosen) { chosen.classList.remove("chosen"); chosen.tabIndex = -1; chosen.removeAttribute("aria-pressed"); }
  chosen = panel;
  panel.classList.add("chosen");
  panel.tabIndex = 0;
  panel.setAttribute("aria-pressed", "true");
  if (focus) panel.focus({preventScroll: true});
  if (show) {
    const {e: x, f: y} = panel.transform.baseVal.consolidate().matrix;
    if (x < view[0] || y < view[1] || x + 64 > view[0] + view[2] || y + 64 > view[1] + view[3]) look([x + 32 - view[2] / 2, y + 32 - view[3] / 2, view[2], view[3]]);
  }
  const target = targetOf(key);
  details.replaceChildren(...(target >= 0 ? nodeDetails(target) : leafDetails(~target)));
}
plan.addEventListener("click", event => {
  const panel = event.target.closest(".panel");
  if (panel && travelled <= 6) choose(panel.id, {focus: true});
});
function neighbour(target, step) {
  const [parent, number] = parents.get(target) ?? [];
  const next = parent === undefined ? undefined : data.nodes[parent].branches[number + step];
  return next ? next[4] : target;
}
plan.addEventListener("keydown", event => {
  const panel = event.target.closest(".panel");
  if (!panel) return;
  const target = targetOf(panel.id);
  const moves = {
    ArrowUp: () => parents.get(target)?.[0] ?? target,
    ArrowDown: () => target >= 0 && data.nodes[target].branches.length ? data.nodes[target].branches[0][4] : target,
    ArrowLeft: () => neighbour(target, -1), ArrowRight: () => neighbour(target, 1), Home: () => 0, Enter: () => target, " ": () => target,
  };
  if (event.key === "+") zoom(1 / 1.4);
  else if (event.key === "-") zoom(1.4);
  else if (event.key === "0") look([...whole]);
  else if (moves[event.key]) choose(keyOf(moves[event.key]()), {focus: true, show: true});
  else return;
  event.preventDefault();
});
document.getElementById("goto").addEventListener("change", event => {
  const widths = event.target.value.trim().split(/[\s,;]+/).map(Number);
  if (widths.every(width => width > 0) && /[\s,;.]/.test(event.target.value.trim())) { follow(widths); return; }
  const found = /^\s*(node|leaf)?\D*(\d+)\s*$/i.exec(event.target.value);
  if (found) choose(`${(found[1] ?? "node").toLowerCase()}-${found[2]}`, {show: true});
});
addEventListener("hashchange", () => choose(location.hash.slice(1), {show: true}));

// Details.
function make(name, attributes = {}, ...children) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...children);
  return element;
}
function shape(name, attributes = {}, ...children) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...children);
  return element;
}
const placed = ([x, y, turn]) => `translate(${x} ${y})rotate(${turn * 180 / Math.PI})`;
const partOf = which => which ? `#part-${which}` : "#part";
const poseOf = ([x, y, turn]) => [x / 1000, y / 1000, turn / 1e6];
function scene(r, belief, label, ...more) {
  const fill = 1 - Math.pow(0.3, 1 / Math.max(belief.length, 1));
  const outlines = belief.map(([x, y, turn, which = 0]) => shape("use", {href: partOf(which), class: `p${which % 6}`, transform: placed([x / 100, y / 100, turn / 1000])}));
  const group = shape("g", {class: "belief", "fill-opacity": fill, "stroke-opacity": Math.min(0.8, 4 * fill)}, ...outlines);
  return shape("svg", {viewBox: `${-r} ${-r} ${2 * r} ${2 * r}`, role: "img", "aria-label": label}, shape("g", {transform: "scale(1 -1)"}, group, ...more));
}
function hand(place, width, kind) {
  const [, length, thickness] = data.jaws;
  const box = y => shape("rect", {class: kind, x: -length / 2, y, width: length, height: thickness});
  return shape("g", {transform: placed(poseOf(place))}, box(width / 2), box(-width / 2 - thickness));
}
function facts(pairs) {
  return make("dl", {class: "facts"}, ...pairs.flatMap(([name, value]) => [make("dt", {}, name), make("dd", {}, value)]));
}
function link(target) {
  const button = make("button", {type: "button"}, nameOf(target));
  button.addEventListener("click", () => choose(keyOf(target), {show: true}));
  return button;
}
function histogram(node, mark) {
  const most = Math.max(1, ...node.seen.map(([, number]) => number));
  const bands = node.map.map(([first, last, branch]) => shape("rect", {class: `c${branch % 6}`, "fill-opacity": .3, x: across(first), y: 0, width: across(last - first + 1), height: 62}));
  const bars = node.seen.map(([width, number]) => {
    const run = node.map.find(([first, last]) => first <= width && width <= last), height = 60 * Math.sqrt(number / most);
    return shape("rect", {class: run ? `c${run[2] % 6}` : "", x: across(width), y: 62 - height, width: across(data.bin), height});
  });
  const names = node.map.filter(([first, last]) => across(last - first) > 6).map(([first, last, branch]) => shape("text", {x: across((first + last) / 2), y: 10, "text-anchor": "middle"}, String(branch)));
  const axis = [0, 0.5, 1].map(share => shape("text", {x: 256 * share, y: 74, "text-anchor": ["start", "middle", "end"][2 * share]}, `${(share * data.opening / 1000).toFixed(0)} mm`));
  const line = mark === undefined ? [] : [shape("path", {d: `M${across(mark)} 0V62`, stroke: "#1a1a1a", "stroke-width": 1.5})];
  return shape("svg", {viewBox: "0 0 256 78", role: "img", "aria-label": "Widths read in the replay, and the branch that each means"}, ...bands, ...bars, ...names, ...line, ...axis);
}
function nodeDetails(index, mark) {
  const node = data.nodes[index], [x, y, turn] = node.place;
  const rows = node.branches.map(([low, expected, high, ppm, target, seen], number) => {
    const runs = node.map.filter(run => run[2] === number).map(([first, last]) => `${mm(first)}\u2013${mm(last)}`).join(", ");
    const cells = [String(number), `${mm(low)}\u2013${mm(high)}`, mm(expected), runs, percent(ppm / 1e6), String(logged(index, target) ?? seen)];
    return make("tr", {}, ...cells.map(text => make("td", {}, text)), make("td", {}, link(target)));
  });
  const heads = ["#", "width [mm]", "expected", "read at [mm]", "planned", data.log ? "in the cell" : "replayed", "to"];
  const rejected = logged(index, null) ?? node.rejected;
  const up = parents.get(index);
  return [
    make("h3", {}, `Node ${index}`, ...(up ? [" after ", link(up[0])] : [])),
    scene(Math.max(data.reach, node.opening / 2000 + data.jaws[2]), node.belief, "Where the part may lie, and the open fingers", hand(node.place, node.opening / 1000, "open")),
    facts([
      ["hand", `${mm(x)}, ${mm(y)} mm, ${degrees(turn)}\u00b0`], ["opening", `${mm(node.opening)} mm`],
      ["force, speed", `${(node.force / 1000).toFixed(0)} N, ${(node.speed / 1000).toFixed(0)} mm/s`],
      ["clearance", `${mm(node.clearance)} mm`], ...(node.release ? [["dragged to", node.release.map(mm).join(", ") + " mm"]] : []),
      ...node.pushes.map(([x, y, turn, opening, way]) => ["pushed before", `from ${mm(x)}, ${mm(y)} mm, ${mm(way)} mm along ${degrees(turn)}\u00b0, jaws ${mm(opening)} mm`]),
      ["parts here", `${node.visits} of ${data.trials} replayed (${percent(node.visits / data.trials)})`], ["rejected here", String(rejected)],
    ]),
    histogram(node, mark),
    make("div", {class: "wide", tabindex: "0", role: "region", "aria-label": "Branches"}, make("table", {}, make("thead", {}, make("tr", {}, ...heads.map(text => make("th", {scope: "col"}, text)))), make("tbody", {}, ...rows))),
  ];
}
function datumAt(pose, datum) {
  const [x, y, turn] = poseOf(pose), [dx, dy, angle] = datum;
  const across = x + Math.cos(turn) * dx - Math.sin(turn) * dy, up = y + Math.sin(turn) * dx + Math.cos(turn) * dy;
  return `${across.toFixed(2)}, ${up.toFixed(2)} mm, ${(turn * 180 / Math.PI + angle).toFixed(1)}\u00b0`;
}
function leafDetails(index) {
  const leaf = data.leaves[index], [x, y, turn] = leaf.pose, up = parents.get(~index);
  const which = data.which?.[index] ?? [0], posed = data.posed ?? true, own = data.parts?.[which[0]];
  const datum = own ? own.datum : data.datum, name = data.named ? own.name : null;
  const outline = (pose, kind, part) => shape("use", {href: partOf(part ?? which[0]), class: `predicted ${kind}`, transform: placed(poseOf(pose))});
  const shown = posed ? [outline(leaf.pose, ""), ...leaf.alternatives.map((pose, k) => outline(pose, "other", which[k + 1]))] : [];
  const [xx, , yy, , , tt] = leaf.covariance;
  return [
    make("h3", {}, `Leaf ${index}`, ...(up ? [" after ", link(up[0])] : [])),
    scene(data.reach, leaf.belief, `Where parts that end here lie${posed ? ", and the predicted pose" : ""}`, ...shown),
    facts([
      ["says", leaf.resolved ? (name === null ? "the part is located" : `${posed ? "located" : "named"}: ${name}`) : "unresolved: it does not know"],
      ...(posed ? [["pose", `${mm(x)}, ${mm(y)} mm, ${degrees(turn)}\u00b0`]] : []),
      ...(posed && datum ? [["datum", datumAt(leaf.pose, datum)]] : []),
      ...(posed ? [["spread", `${(Math.sqrt(xx) / 10).toFixed(2)}, ${(Math.sqrt(yy) / 10).toFixed(2)} mm, ${(Math.sqrt(tt) * 0.57296).toFixed(1)}\u00b0`]] : []),
      ["success", leaf.trials ? `${percent(leaf.success / 1e6)} of ${leaf.trials}` : "untried"],
      ["95 % interval", `${percent(leaf.interval[0])} to ${percent(leaf.interval[1])}`],
      ["parts here", `${leaf.visits} of ${data.trials} replayed`],
      ...(data.log ? [["in the cell", `${logged(up[0], ~index)} parts`]] : []),
      ...(posed ? leaf.alternatives : []).map((pose, k) => [k ? "" : "or at", `${mm(pose[0])}, ${mm(pose[1])} mm, ${degrees(pose[2])}\u00b0`]),
    ]),
  ];
}
const tally = new Map((data.log?.branches ?? []).map(([node, target, number]) => [`${node}:${target}`, number]));
const logged = (node, target) => data.log ? tally.get(`${node}:${target}`) ?? 0 : undefined;
const readable = 1.5 * plan.clientWidth;
function begin() {  // at the root, where one can read
  if (whole[2] <= readable) { look([...whole]); return; }
  const root = document.getElementById("node-0").transform.baseVal.consolidate().matrix;
  look([root.e + 32 - readable / 2, 0, readable, readable * plan.clientHeight / plan.clientWidth]);
}
begin();

// Lengths in um, angles in urad, shares in ppm. A target >= 0 is a node, < 0 the leaf ~target.
const rows = columns => Object.values(columns).at(0).map((_, row) => Object.fromEntries(Object.entries(columns).map(([name, values]) => [name, values.at(row)])));
const table = JSON.parse(byId("data").textContent);
const nodes = rows(table.nodes).map(node => ({...node, branches: []})), leaves = rows(table.leaves);
const parents = new Map();
for (const branch of rows(table.branches)) {
  const {branches} = nodes[branch.node];
  parents.set(branch.target, {index: branch.node, number: branches.length});
  branches.push(branch);
}
const keyOf = target => target >= 0 ? `node-${target}` : `leaf-${~target}`;
const nameOf = target => target >= 0 ? `node ${target}` : `leaf ${~target}`;
const branchesOf = target => target >= 0 ? nodes[target].branches : [];
const rounded = (um, digits) => (Number((um / 1000).toFixed(digits)) + 0).toFixed(digits); // no negative zero
const mm = um => rounded(um, 2), short = um => rounded(um, 1);
const degrees = urad => Math.round(urad / 1e6 * 180 / Math.PI * 10) / 10, percent = share => `${(share / 1e4).toFixed(1)} %`;
const targetOf = key => key.startsWith("node-") ? Number(key.slice(5)) : ~Number(key.slice(5));
const MANY = 600, LEAST_PPM = 10_000, MARGIN_MM = 3, APART = 9, POLL_MS = 400, LOST_MS = 2000;

// What panels show: the open hand at its place, or the part where a leaf says it lies.
const length = table.finger_length_um / 1000, thickness = table.finger_width_um / 1000;
const far = Math.max(1, ...table.outlines.flat().map(([x, y]) => Math.hypot(x, y)));
const reaches = [...nodes.map(node => Math.hypot(node.opening_um / 2000 + thickness, length / 2)), ...leaves.map(leaf => leaf.resolved ? far : 0)];
const reach = Math.max(far, ...[...nodes, ...leaves].map((at, index) => Math.hypot(at.x_um, at.y_um) / 1000 + reaches.at(index)));
const placed = ({x_um, y_um, angle_urad, theta_urad}) => `translate(${x_um / 1000} ${y_um / 1000})rotate(${(angle_urad ?? theta_urad) / 1e6 * 180 / Math.PI})`;
const outlines = table.outlines.map(outline => outline.map(point => point.join()).join(" "));
function picture(target) {
  const at = target >= 0 ? nodes[target] : leaves[~target], inside = [];
  if (target >= 0) {
    const box = y => shape("rect", {class: "finger", x: -length / 2, y, width: length, height: thickness});
    const tip = at.opening_um / 2000, arrow = side => shape("polygon", {class: "arrow", points: `${-reach / 11},${side * tip} ${reach / 11},${side * tip} 0,${side * (tip - reach / 4)}`});
    inside.push(box(tip), box(-tip - thickness), arrow(1), arrow(-1));
  } else if (at.resolved && table.posed) {
    if (at.hypothesis in outlines) inside.push(shape("polygon", {class: "predicted", points: outlines[at.hypothesis]}));
    inside.push(shape("line", {class: "cross", x1: 0, y1: 0, x2: far / 2, y2: 0}), shape("line", {class: "cross", x1: 0, y1: -far / 8, x2: 0, y2: far / 8}));
  }
  const world = shape("g", {transform: "scale(1 -1)"}, shape("g", {transform: placed(at)}, ...inside));
  return shape("svg", {class: "scene", viewBox: `${-reach} ${-reach} ${2 * reach} ${2 * reach}`}, world);
}
function answerOf(leaf) {
  const pose = `${short(leaf.x_um)}, ${short(leaf.y_um)} mm, ${degrees(leaf.theta_urad)}°`;
  return leaf.resolved ? [table.names[leaf.hypothesis], table.posed && pose].filter(Boolean).join(": ") : "unresolved";
}
function labelOf(target) {
  if (target < 0) return `Leaf ${~target}: ${answerOf(leaves[~target])}`;
  return `Node ${target}: squeeze at ${degrees(nodes[target].angle_urad)} degrees, ${nodes[target].branches.length} outcomes`;
}

// The tree: all of it, or a part's way with its side branches. Branches that few parts take are folded.
const view = byId("plan"), near = byId("near"), follow = byId("follow"), details = byId("details");
function withAncestors(targets) {
  const found = new Set(targets);
  for (let target of targets) while ((target = parents.get(target)?.index) !== undefined) found.add(target);
  return found;
}
function panelOf(target) {
  const kind = target >= 0 ? "node" : !leaves[~target].resolved ? "unresolved" : leaves[~target].trials ? "leaf" : "untried";
  const text = target >= 0 ? `${degrees(nodes[target].angle_urad)}°` : answerOf(leaves[~target]);
  return make("button", {type: "button", class: `panel ${kind}`, id: keyOf(target), "aria-label": labelOf(target)}, picture(target), make("span", {class: "words"}, nameOf(target), make("br"), text));
}
function wayOf({low_um, high_um, probability_ppm, target}) {
  return make("span", {class: "way", id: `to-${keyOf(target)}`}, `${short(low_um)}\u2013${short(high_um)} mm `, make("br"), make("small", {}, percent(probability_ppm)));
}
function listOf(branches, share) {
  return make("ol", {}, ...branches.map(branch => make("li", {}, wayOf(branch), ...below(branch.target, share * branch.probability_ppm / 1e6))));
}
function below(target, share) {
  const shown = near.checked && !open.has(target) ? [] : branchesOf(target);
  const rare = shown.length < 2 ? [] : shown.filter(branch => share * branch.probability_ppm < LEAST_PPM);
  const usual = shown.filter(branch => !rare.includes(branch));
  const list = listOf(usual, share);
  if (rare.length) list.append(make("li", {class: "light"}, make("details", {}, make("summary", {}, `${rare.length} more`), listOf(rare, share))));
  return shown.length ? [panelOf(target), list] : [panelOf(target)];
}
let way = new Set([0]), now = 0, chosen = 0, open = way, drawn = "", told = "";
near.checked = nodes.length + leaves.length > MANY;
function draw() {
  open = withAncestors([...way, chosen]);
  const state = near.checked ? [...open].sort().join() : "all";
  if (state === drawn) return;
  drawn = state;
  const focused = view.contains(document.activeElement) ? document.activeElement.id : "";
  const root = make("ol", {}, make("li", {}, ...below(0, 1)));
  view.replaceChildren(root);
  view.style.setProperty("--levels", Math.max(...[...view.querySelectorAll(".panel")].map(panel => withAncestors([targetOf(panel.id)]).size)));
  told = ""; // the chosen panel is a new one
  if (focused) (byId(focused) ?? view).focus({preventScroll: true});
}
// Scrolls the tree alone, not the page.
function show(key) {
  const box = byId(key)?.getBoundingClientRect(), frame = view.getBoundingClientRect();
  if (!box) return;
  if (box.left < frame.left || box.right > frame.right) view.scrollLeft += (box.left + box.right - frame.left - frame.right) / 2;
  if (box.top < frame.top || box.bottom > frame.bottom) view.scrollTop += (box.top + box.bottom - frame.top - frame.bottom) / 2;
}

// The details of the chosen panel.
let steps = [];
const link = target => make("button", {type: "button", "data-to": keyOf(target)}, nameOf(target));
function spanOf({branches}) {
  const low = Math.min(...branches.map(branch => branch.low_um)), high = Math.max(...branches.map(branch => branch.high_um));
  return {low: Math.max(low / 1000 - MARGIN_MM, 0), high: high / 1000 + MARGIN_MM};
}
function chartOf(node) {
  const {low, high} = spanOf(node), at = um => 100 * (um / 1000 - low) / (high - low), named = [];
  const bands = node.branches.map(({low_um, high_um}, number) => shape("rect", {class: `band s${number % 6}`, x: at(low_um), width: at(high_um) - at(low_um), height: 100}));
  node.branches.forEach(({low_um, high_um}, number) => {
    const left = at((low_um + high_um) / 2);
    if (named.every(other => Math.abs(other.left - left) >= APART)) named.push({left, number});
  });
  const names = named.map(({left, number}) => make("span", {style: `left:${left}%`}, String(number)));
  const ends = [low, high].map(width => make("span", {}, `${width.toFixed(1)} mm`));
  const picture = shape("svg", {viewBox: "0 0 100 100", preserveAspectRatio: "none", "aria-hidden": "true"}, ...bands);
  return make("div", {class: "chart", role: "img", "aria-label": "Widths of each outcome"}, make("p", {class: "bands"}, ...names), picture, make("p", {class: "axis"}, ...ends));
}
function detailsOf(target) {
  const up = parents.get(target), head = make("h3", {}, nameOf(target).replace(/^./, first => first.toUpperCase()), ...(up ? [" after ", link(up.index)] : []));
  if (target < 0) {
    const leaf = leaves[~target], tried = leaf.trials ? `${percent(leaf.success_ppm)} of ${leaf.trials} simulated parts were within the goal.` : "Not tried.";
    return [head, make("p", {}, leaf.resolved ? `Answer: ${answerOf(leaf)}.` : "Unresolved: the table cannot tell the pose well enough."), make("p", {}, tried)];
  }
  const node = nodes[target], step = steps.findLast(one => one.node === target);
  const text = `Hand at ${mm(node.x_um)}, ${mm(node.y_um)} mm, ${degrees(node.angle_urad)}°, open ${mm(node.opening_um)} mm; closes at ${short(node.speed_um_s)} mm/s with ${short(node.force_mn)} N.`;
  const rows = node.branches.map((branch, number) => {
    const cells = [String(number), `${mm(branch.low_um)}–${mm(branch.high_um)}`, percent(branch.probability_ppm)].map(cell => make("td", {}, cell));
    return make("tr", step?.target === branch.target ? {class: "came"} : {}, ...cells, make("td", {}, link(branch.target)));
  });
  const heads = ["branch", "width [mm]", "planned", "to"].map(name => make("th", {scope: "col"}, name));
  const read = step ? `Read ${step.width_mm.toFixed(2)} mm: ${step.target === null ? "rejected" : `on to ${nameOf(step.target)}`}.` : "This part was not squeezed here.";
  return [head, make("p", {}, text), chartOf(node), make("p", {id: "read"}, read), make("table", {}, make("thead", {}, make("tr", {}, ...heads)), make("tbody", {}, ...rows))];
}
function about(key, byHand) {
  if (byHand) follow.checked = false;
  chosen = targetOf(key);
  told = JSON.stringify([chosen, steps]);
  const text = make("div", {}, ...detailsOf(chosen)), step = steps.findLast(one => one.node === chosen);
  if (step) pointAt(text, step.width_mm, spanOf(nodes[chosen]));
  if (near.checked) setTimeout(() => lookAt(chosen)); // what follows it
  return text;
}
const {choose, mark} = treeView(view, details, about);
document.addEventListener("click", event => {
  const to = event.target.closest("[data-to]")?.dataset.to;
  if (to) chosen = targetOf(to), draw(); // where only this part's way is drawn
}, true);

// Polls the state; a hidden page requests nothing.
function take(state) {
  steps = state.steps;
  const last = steps.at(-1);
  now = state.node ?? last?.target ?? (last ? last.node : 0);
  const reached = steps.flatMap(step => step.target === null ? [step.node] : [step.node, step.target]);
  way = withAncestors([...reached, now]);  // after a crash the first squeezes are not among the steps
  lookAt(follow.checked ? now : chosen);
}
function lookAt(target) {
  chosen = target;
  draw();
  mark([...way].map(keyOf));
  for (const panel of view.querySelectorAll("[aria-current]")) panel.removeAttribute("aria-current");
  byId(keyOf(now))?.setAttribute("aria-current", "step");
  if (JSON.stringify([chosen, steps]) === told) return;  // what has the focus stays
  choose(keyOf(chosen));
  show(keyOf(chosen));
}
const shownTree = byId("tree"), latest = new Map();
async function fetched(path) {
  try {
    const answer = await fetch(path, {signal: AbortSignal.timeout(5000)});
    return answer.ok ? await answer.text() : null;
  } catch {
    return null;
  }
}
function put(text) {
  const parsed = new DOMParser().parseFromString(text, "text/html");
  for (const id of ["state", "screen"]) {
    const next = parsed.getElementById(id);
    if (latest.get(id) === next.innerHTML) continue;  // what is read or scrolled stays
    latest.set(id, next.innerHTML);
    byId(id).replaceChildren(...next.childNodes);
  }
  byId("link").hidden = true;
}
function lose() {
  const ended = byId("state").querySelector("[data-ended]");
  byId("link").hidden = Boolean(ended);
  byId("link").textContent = "The cell does not answer: the run has ended, or the connection is lost. Trying again.";
}
async function ask() {
  const text = document.hidden ? undefined : await fetched("screen.html");
  setTimeout(ask, text === null ? LOST_MS : POLL_MS);
  if (text === undefined) return;
  if (text === null) return lose();
  put(text);
  const state = shownTree.open ? await fetched("status.json") : null;
  if (state) take(JSON.parse(state));
}
near.addEventListener("change", () => lookAt(chosen));
follow.addEventListener("change", () => { if (follow.checked) lookAt(now); });
shownTree.addEventListener("toggle", () => show(keyOf(chosen)));
lookAt(0);
ask();

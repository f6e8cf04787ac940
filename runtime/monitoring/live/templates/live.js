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
const mm = um => (um / 1000).toFixed(2), short = um => (um / 1000).toFixed(1);
const degrees = urad => Math.round(urad / 1e6 * 180 / Math.PI * 10) / 10, percent = share => `${(share / 1e4).toFixed(1)} %`;
const PANEL = 64, GAP = 58, EDGE = 10, MANY = 600, POLL_MS = 400, LOST_MS = 2000;
const words = (x, y, kind, text) => shape("text", {x, y, class: kind}, text);

// Places: subtrees side by side, as close as their contours allow (Reingold and Tilford, 1981).
function tidy(target, shown) {
  const half = target < 0 ? 0.5 * PANEL + 6 : 0.5 * PANEL;
  const children = branchesOf(target).filter(branch => shown(branch.target)).map(branch => tidy(branch.target, shown));
  const merged = [];
  for (const child of children) {
    child.x = Math.max(0, ...child.contour.map(({low}, depth) => depth < merged.length ? merged[depth].high - low + 8 : 0));
    child.contour.forEach(({low, high}, depth) => {
      const row = merged[depth] ?? {low: Infinity, high: -Infinity};
      merged[depth] = {low: Math.min(row.low, low + child.x), high: Math.max(row.high, high + child.x)};
    });
  }
  const middle = children.length ? (children.at(0).x + children.at(-1).x) / 2 : 0;
  for (const child of children) child.x -= middle;
  return {target, x: 0, children, contour: [{low: -half, high: half}, ...merged.map(({low, high}) => ({low: low - middle, high: high - middle}))]};
}

// What panels show: the open hand at its place, or the part where a leaf says it lies.
const length = table.finger_length_um / 1000, thickness = table.finger_width_um / 1000;
const far = Math.max(1, ...table.outline.map(([x, y]) => Math.hypot(x, y)));
const reach = Math.max(table.opening_um / 2000 + thickness, far, ...leaves.map(leaf => Math.hypot(leaf.x_um, leaf.y_um) / 1000 + (leaf.resolved ? far : 0)));
const placed = ({x_um, y_um, angle_urad, theta_urad}) => `translate(${x_um / 1000} ${y_um / 1000})rotate(${(angle_urad ?? theta_urad) / 1e6 * 180 / Math.PI})`;
const outline = table.outline.map(point => point.join()).join(" ");
function picture(target) {
  const at = target >= 0 ? nodes[target] : leaves[~target], inside = [];
  if (target >= 0) {
    const box = y => shape("rect", {class: "finger", x: -length / 2, y, width: length, height: thickness});
    const tip = at.opening_um / 2000, arrow = side => shape("polygon", {class: "arrow", points: `${-reach / 11},${side * tip} ${reach / 11},${side * tip} 0,${side * (tip - reach / 4)}`});
    inside.push(box(tip), box(-tip - thickness), arrow(1), arrow(-1));
  } else if (at.resolved) {
    if (outline) inside.push(shape("polygon", {class: "predicted", points: outline}));
    inside.push(shape("line", {class: "axis", x1: 0, y1: 0, x2: far / 2, y2: 0}), shape("line", {class: "axis", x1: 0, y1: -far / 8, x2: 0, y2: far / 8}));
  }
  const world = shape("g", {transform: "scale(1 -1)"}, shape("g", {transform: placed(at)}, ...inside));
  return shape("svg", {width: PANEL, height: PANEL, viewBox: `${-reach} ${-reach} ${2 * reach} ${2 * reach}`}, world);
}
function labelOf(target) {
  if (target >= 0) return `Node ${target}: squeeze at ${degrees(nodes[target].angle_urad)} degrees, ${nodes[target].branches.length} outcomes`;
  const leaf = leaves[~target];
  return `Leaf ${~target}: ` + (leaf.resolved ? `part at ${short(leaf.x_um)}, ${short(leaf.y_um)} mm, ${degrees(leaf.theta_urad)} degrees` : "unresolved");
}

// The drawing, all of it or what lies beside the part's way.
const view = byId("view"), near = byId("near"), follow = byId("follow");
function withAncestors(targets) {
  const found = new Set(targets);
  for (let target of targets) while ((target = parents.get(target)?.index) !== undefined) found.add(target);
  return found;
}
let zoom = 1, size = {width: 0, height: 0}, way = new Set([0]), now = 0, chosen = 0, drawn = "";
near.checked = nodes.length + leaves.length > MANY;
function draw() {
  const open = withAncestors([...way, chosen]);
  const shown = near.checked ? target => open.has(parents.get(target)?.index ?? 0) : () => true;
  const state = near.checked ? [...open].filter(target => target >= 0).sort().join() : "all";
  if (state === drawn) return;
  drawn = state;
  const focused = view.contains(document.activeElement) ? document.activeElement.id : "";
  const root = tidy(0, shown), back = shape("g"), front = shape("g"), labels = shape("g", {"aria-hidden": "true"});
  const left = Math.min(...root.contour.map(row => row.low)), right = Math.max(...root.contour.map(row => row.high));
  const place = (spot, x, depth) => {
    const y = EDGE + depth * (PANEL + GAP), kind = spot.target >= 0 ? "node" : leaves[~spot.target].resolved ? "leaf" : "unresolved";
    const frame = shape("rect", {class: "frame", width: PANEL, height: PANEL, rx: 3});
    front.append(shape("g", {class: `panel ${kind}`, id: keyOf(spot.target), role: "button", tabindex: -1, "aria-label": labelOf(spot.target), transform: `translate(${x - PANEL / 2} ${y})`, "data-target": spot.target}, frame, picture(spot.target)));
    labels.append(words(spot.children.length ? x - 22 : x, y + PANEL + 10, "", spot.target >= 0 ? `${degrees(nodes[spot.target].angle_urad)}°` : nameOf(spot.target)));
    for (const child of spot.children) {
      const to = x + child.x, bus = y + PANEL + 14, branch = nodes[spot.target].branches[parents.get(child.target).number];
      back.append(shape("path", {class: "branch", id: `to-${keyOf(child.target)}`, d: `M${x} ${y + PANEL}V${bus}H${to}V${y + PANEL + GAP}`}));
      labels.append(words(to, bus + 14, "", `${short(branch.low_um)}–${short(branch.high_um)}`), words(to, bus + 26, "share", percent(branch.probability_ppm)));
      place(child, to, depth + 1);
    }
  };
  place(root, EDGE - left, 0);
  size = {width: right - left + 2 * EDGE, height: root.contour.length * (PANEL + GAP) - GAP + 2 * EDGE + 14};
  view.replaceChildren(shape("svg", {id: "plan", viewBox: `0 0 ${size.width} ${size.height}`, role: "group", "aria-label": "Nodes and leaves"}, back, front, labels));
  scale(zoom);
  mark();
  if (focused && focused !== "view") (byId(focused) ?? view).focus({preventScroll: true});
}
function scale(next) {
  zoom = Math.min(Math.max(next, 0.05), 6);
  const plan = byId("plan");
  plan.setAttribute("width", size.width * zoom);
  plan.setAttribute("height", size.height * zoom);
}
const fitted = () => Math.min(1.6, (view.clientWidth - 4) / size.width, (view.clientHeight - 4) / size.height);
function show(target) {
  const panel = byId(keyOf(target));
  if (!panel) return;
  const box = panel.getBoundingClientRect(), frame = view.getBoundingClientRect();
  const x = box.left - frame.left, y = box.top - frame.top;
  if (x < 0 || x + box.width > frame.width) view.scrollLeft += x + box.width / 2 - frame.width / 2;
  if (y < 0 || y + box.height > frame.height) view.scrollTop += y + box.height / 2 - frame.height / 2;
}
function mark() {
  for (const panel of view.querySelectorAll(".panel")) {
    const target = Number(panel.dataset.target);
    panel.classList.toggle("taken", way.has(target));
    panel.classList.toggle("now", target === now);
    panel.classList.toggle("chosen", target === chosen);
    panel.setAttribute("aria-pressed", String(target === chosen));
    panel.setAttribute("tabindex", target === chosen ? 0 : -1);
    if (target === now) panel.setAttribute("aria-current", "step");
    else panel.removeAttribute("aria-current");
  }
  for (const line of view.querySelectorAll(".branch")) line.classList.toggle("taken", [...way].some(target => line.id === `to-${keyOf(target)}`));
}
byId("in").addEventListener("click", () => { scale(zoom * 1.4); show(chosen); });
byId("out").addEventListener("click", () => { scale(zoom / 1.4); show(chosen); });
byId("fit").addEventListener("click", () => scale(fitted()));
near.addEventListener("change", draw);
follow.addEventListener("change", () => { if (follow.checked) choose(now); });

// What is known of the panel that is looked at.
let steps = [];
function link(target) {
  const button = make("button", {type: "button"}, nameOf(target));
  button.addEventListener("click", () => { follow.checked = false; choose(target); });
  return button;
}
function spans(node, width) {
  const x = um => 256 * um / table.opening_um, y = number => 2 + 15 * (number % 2);
  const bars = node.branches.map(({low_um, high_um}, number) => shape("rect", {class: `span s${number % 6}`, x: x(low_um), y: y(number), width: Math.max(x(high_um) - x(low_um), 1), height: 14}));
  const middles = node.branches.map(({low_um, high_um}) => x((low_um + high_um) / 2)), named = [];
  middles.forEach((middle, number) => { if (named.every(other => Math.abs(middles[other] - middle) > 8)) named.push(number); });
  const names = named.map(number => words(middles[number], 45, "", String(number)));
  const line = width === undefined ? [] : [shape("path", {class: "seen", d: `M${x(1000 * width)} 0V34`})];
  const label = "Widths of each outcome, between the jaws closed and open" + (width === undefined ? "" : `; ${width.toFixed(2)} mm was read`);
  return shape("svg", {viewBox: "-14 0 276 62", role: "img", "aria-label": label}, ...bars, ...names, ...line, words(0, 59, "", "0 mm"), words(260, 59, "end", `${short(table.opening_um)} mm`));
}
function detailsOf(target) {
  const up = parents.get(target), head = make("h3", {}, nameOf(target).replace(/^./, first => first.toUpperCase()), ...(up ? [" after ", link(up.index)] : []));
  if (target < 0) {
    const leaf = leaves[~target], tried = leaf.trials ? `${percent(leaf.success_ppm)} of ${leaf.trials} simulated parts were within the goal.` : "Not tried.";
    return [head, make("p", {}, leaf.resolved ? `The part lies at ${mm(leaf.x_um)}, ${mm(leaf.y_um)} mm, ${degrees(leaf.theta_urad)}°.` : "Unresolved: the table cannot tell the pose well enough."), make("p", {}, tried)];
  }
  const node = nodes[target], step = steps.findLast(one => one.node === target);
  const text = `Hand at ${mm(node.x_um)}, ${mm(node.y_um)} mm, ${degrees(node.angle_urad)}°, open ${mm(node.opening_um)} mm; closes at ${short(node.speed_um_s)} mm/s with ${short(node.force_mn)} N.`;
  const rows = node.branches.map((branch, number) => {
    const cells = [String(number), `${mm(branch.low_um)}–${mm(branch.high_um)}`, percent(branch.probability_ppm)].map(cell => make("td", {}, cell));
    return make("tr", step?.target === branch.target ? {class: "came"} : {}, ...cells, make("td", {}, link(branch.target)));
  });
  const heads = ["branch", "width [mm]", "planned", "to"].map(name => make("th", {scope: "col"}, name));
  const read = step ? `Read ${step.width_mm.toFixed(2)} mm: ${step.target === null ? "rejected" : `on to ${nameOf(step.target)}`}.` : "This part was not squeezed here.";
  return [head, make("p", {}, text), spans(node, step?.width_mm), make("p", {id: "read"}, read), make("table", {}, make("thead", {}, make("tr", {}, ...heads)), make("tbody", {}, ...rows))];
}
let told = "";
function choose(target, focus = false) {
  const state = JSON.stringify([target, steps]);
  chosen = target;
  draw();
  mark();
  show(target);
  if (focus) byId(keyOf(target))?.focus({preventScroll: true});
  if (state === told) return;  // what has the focus stays
  told = state;
  byId("details").replaceChildren(...detailsOf(target));
}
view.addEventListener("click", event => {
  const panel = event.target.closest(".panel");
  if (!panel) return;
  follow.checked = false;
  choose(Number(panel.dataset.target), true);
});
view.addEventListener("keydown", event => {
  const panel = event.target.closest(".panel");
  if (!panel) return;
  const target = Number(panel.dataset.target), up = parents.get(target);
  const beside = step => nodes[up?.index]?.branches[up.number + step]?.target ?? target;
  const moves = {ArrowUp: () => up?.index ?? target, ArrowDown: () => branchesOf(target)[0]?.target ?? target, ArrowLeft: () => beside(-1), ArrowRight: () => beside(1), Home: () => 0, Enter: () => target, " ": () => target};
  if (!moves[event.key]) return;
  event.preventDefault();
  follow.checked = false;
  const next = moves[event.key]();
  choose(byId(keyOf(next)) ? next : target, true);
});

// The state, asked for again and again; whoever looks elsewhere asks for nothing.
function take(state) {
  steps = state.steps;
  const last = steps.at(-1);
  now = state.node ?? last?.target ?? (last ? last.node : 0);
  const reached = steps.flatMap(step => step.target === null ? [step.node] : [step.node, step.target]);
  way = withAncestors([...reached, now]);  // after a crash the first squeezes are not among the steps
  draw();
  choose(follow.checked ? now : chosen);
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
shownTree.addEventListener("toggle", () => {
  if (!shownTree.open) return;
  scale(Math.max(fitted(), 0.75));
  show(chosen);
});
draw();
choose(0);
ask();

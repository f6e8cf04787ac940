// The studio's page. All state is in the folder: the page asks for it, and shows names and sentences as text.

import { contourPicture, drawPart } from "./drawing.js";
import { projector } from "./film.js";

const BUSY_MS = 600, IDLE_MS = 3000, SETTLE_MS = 300;
const form = byId("settings");
const proposed = { gripper: "gripper", fingers: "fingers", radius: "radius_mm", turn: "turn_deg", distance: "distance_mm" };
let lost = false; // whether something was asked that got no answer
let touched = {}; // settings that a person chose; the others follow the drawing
let contour = "", drawing = "", asked = 0, waiting = 0, known = "", preview = null, begun = "";
let refused = "", underWay = ""; // why a setting is refused, and the plan of any tab that is being planned

function tell(sentence) {
  byId("error").hidden = !sentence;
  byId("error").textContent = sentence ?? "";
}

async function ask(path, query, body) {
  const options = body === undefined ? {} : { method: "POST", body };
  let response;
  try {
    response = await fetch(`${path}?${new URLSearchParams(query)}`, options);
  } catch {
    lost = true;
    throw new Error("The studio does not answer; begin it again with squeezetree studio. Nothing is lost.");
  }
  const answer = await response.json();
  if (!response.ok) throw new Error(answer.error);
  return answer;
}

// Runs what a person asked for; why it failed is on the page.
function attempt(work) {
  return async (event) => {
    event?.preventDefault();
    try {
      tell();
      await work(event);
    } catch (error) {
      tell(error.message);
    }
  };
}

function settings() {
  return JSON.stringify({ ...touched, ...(contour && { contour }) });
}

function choose(name) {
  drawing = name;
  contour = "";
  for (const key of ["units", "scale", "radius", "gripper", "thickness"]) delete touched[key], (form.elements[key].value = "");
  byId("drawing").value = name;
  byId("reading").textContent = `Reading ${name} ...`;
  return look();
}

async function look() {
  if (!drawing) return;
  const number = ++asked;
  let answer;
  try {
    answer = await ask("/preview", { drawing }, settings());
  } catch (error) {
    if (number === asked) throw error;
    return;
  } finally {
    if (number === asked) byId("reading").textContent = "";
  }
  if (number !== asked || byId("view").classList.contains("moving")) return; // a later question follows
  byId("command").textContent = answer.command;
  showContours(answer);
  form.hidden = false;
  const before = refused;
  refused = answer.error ?? "";
  showBegin();
  if (refused || byId("error").textContent === before) tell(refused); // other sentences stay
  if (answer.outline) showPart(answer);
  else for (const id of ["view", "facts", "assumed"]) byId(id).replaceChildren();
}

function showContours(answer) {
  const box = byId("contours"), held = document.activeElement?.name === "contour";
  box.hidden = answer.contours.length < 2;
  const labels = answer.contours.map((each) => {
    const input = make("input", { type: "radio", name: "contour", value: each.number });
    input.checked = each.number === answer.contour;
    input.addEventListener("change", attempt(() => ((contour = String(each.number)), look())));
    const label = make("label");
    label.append(contourPicture(each), input, ` ${each.number}: ${each.width_mm} x ${each.height_mm} mm${each.outer ? "" : ", inner"}`);
    return label;
  });
  box.replaceChildren(box.firstElementChild, ...labels);
  if (held) box.querySelector(":checked")?.focus();
}

function showPart(answer) {
  preview = answer;
  for (const [name, key] of Object.entries(proposed)) if (!(name in touched)) form.elements[name].value = answer[key] ?? "";
  if (answer.height_mm !== null && !("thickness" in touched)) form.elements.thickness.placeholder = answer.height_mm;
  drawPart(byId("view"), answer, (radius) => {
    form.elements.radius.value = touched.radius = String(radius);
    showRoom();
    if (!byId("view").classList.contains("moving")) soon();
  });
  byId("assumed").replaceChildren(...answer.assumed.map((line) => make("li", {}, line)));
  const { low, high } = answer.friction;
  byId("fingers-help").textContent = `Its friction on the part is anywhere from ${low} to ${high}; wider bounds cost squeezes.`;
  showRoom();
}

// What the part looks like, and which gripper has room for a disc of this radius.
function showRoom() {
  const turns = preview.symmetry > 1 ? `It looks the same after each turn by ${+(360 / preview.symmetry).toFixed(1)} degrees` : "It looks the same only after a whole turn";
  byId("facts").textContent = `${preview.size}, ${preview.vertices} vertices. ${turns}. Datum: ${preview.datum.name}.`;
  const rooms = Object.entries(preview.rooms_mm).map(([name, mm]) => `${name} ${mm > 0 ? `${mm} mm` : "not at every angle"}`);
  const radius = Number(form.elements.radius.value), room = preview.rooms_mm[preview.gripper];
  const tight = radius > room ? "This disc is larger than that: fingers may come down on the part. " : "";
  byId("gripper-help").textContent = `${tight}Room for the part's centre between open fingers, at any angle: ${rooms.join(", ")}.`;
}

function showBegin() {
  byId("begin").disabled = Boolean(refused || underWay);
  byId("occupied").textContent = underWay && `${underWay} is being planned; stop it, or wait for it.`;
}

function soon() {
  clearTimeout(waiting);
  waiting = setTimeout(attempt(look), SETTLE_MS);
}

async function add(file) {
  if (!file) return;
  const suffixes = byId("file").accept.split(",");
  if (!suffixes.some((suffix) => file.name.toLowerCase().endsWith(suffix))) throw new Error(`${file.name}: is no drawing; those end in ${suffixes.join(", ")}`);
  const { drawing: name } = await ask("/drawings", { name: file.name }, file);
  drawing = name; // refreshing chooses no other
  await refresh();
  await choose(name);
}

function offer(select, names, chosen) {
  select.replaceChildren(...names.map((name) => make("option", { value: name }, name)));
  if (names.includes(chosen)) select.value = chosen;
}

async function refresh() {
  const state = await ask("/folder.json", {});
  const text = JSON.stringify(state);
  if (text !== known) {
    known = text;
    show(state);
    if (!drawing && state.drawings.length) await choose(state.plans.map((plan) => plan.log.drawing).find((name) => state.drawings.includes(name)) ?? state.drawings[0]);
  }
  return state.plans.some((plan) => plan.running);
}

function show({ drawings, plans, files }) {
  offer(byId("drawing"), drawings.length ? drawings : [""], drawing);
  underWay = plans.find((plan) => plan.running)?.name ?? "";
  showBegin();
  const names = plans.map((plan) => plan.name);
  offer(byId("plans"), names, begun || byId("plans").value);
  if (names.includes(begun)) begun = "";
  byId("files").replaceChildren(...files.map((file) => make("li", {}, link(file.name, file.name), ` ${(file.size / 1024).toFixed(1)} KB`)));
  byId("plan").hidden = !plans.length;
  const plan = plans.find((each) => each.name === byId("plans").value);
  if (plan) showPlan(plan);
}

function link(file, text) {
  return make("a", { href: `/files/${encodeURIComponent(file)}` }, text);
}

const DOING = { try: "Planning", report: "Writing the report", run: "Simulating 20 parts" };

function statusOf({ running, log }) {
  if (running) return log.step in DOING ? `${DOING[log.step]}: ${log.drawing}` : "Starting";
  if (log.exit === 0) return `Done: ${log.drawing}`;
  if (log.exit === 130) return "It was stopped before it was done; what it wrote is in the folder.";
  return log.exit === null ? "It was ended before it was done; what it wrote is in the folder." : `It ended with exit code ${log.exit}.`;
}

function showPlan(plan) {
  const { log, files, running } = plan, { progress, answer } = log;
  const status = statusOf(plan);
  if (byId("status").textContent !== status) byId("status").textContent = status; // a screen reader says what changes
  byId("stop").hidden = !running && !plan.trying;
  byId("stop").textContent = running ? "Stop, and keep the best so far" : "Try no others";
  byId("stop").disabled = "stop" in files;
  byId("course").hidden = !running;
  if (typeof progress.share === "number") byId("progress").value = progress.share;
  else byId("progress").removeAttribute("value");
  const compiling = progress.stage === "kernels" ? "compiling, once an installation: a minute or two" : progress.stage;
  byId("left").textContent = progress.stage ? [compiling, `${progress.seconds} s so far`, progress.left, progress.detail].filter(Boolean).join(", ") : "";
  byId("verdict").hidden = !answer;
  byId("verdict").textContent = answer ? `Can it be located by squeezing? ${answer.answer}` : "";
  byId("verdict").className = `verdict ${{ cut: "fair", unknown: "poor" }[answer?.grade] ?? answer?.grade}`;
  byId("sentence").textContent = answer?.sentence ?? "";
  byId("numbers").replaceChildren(...(answer?.numbers ?? []).map(({ what, value, more }) => make("div", {}, make("dt", {}, what), make("dd", {}, value), make("dd", { class: "note" }, more))));
  const remarks = answer ? [...answer.warnings, ...answer.limits] : [];
  byId("remarks").replaceChildren(...[...remarks, ...log.lines].map((line) => make("li", {}, line)));
  const links = { report: "Report", table: "Decision table", job: "Job file", journal: "Journal of the simulated parts", log: "Log" };
  byId("links").replaceChildren(...Object.entries(links).filter(([what]) => what in files).map(([what, text]) => link(files[what], text)));
  showPicture(files.picture);
  showParts(plan);
  showTried(plan);
  byId("commands").textContent = log.commands.join("\n");
}

function showPicture(file) {
  const picture = byId("look"), source = file ? `/files/${encodeURIComponent(file)}` : "";
  byId("picture").hidden = !file;
  if (file && picture.getAttribute("src") !== source) picture.src = source;
}

const project = projector({ view: byId("scene"), slider: byId("moment"), button: byId("play"), caption: byId("caption") });
async function showFilm(plan, number) {
  project(await ask("/film.json", { plan, part: number }));
  byId("filmed").textContent = `Part ${number}`;
  byId("film").hidden = false;
  byId("film").scrollIntoView({ block: "nearest" });
}

// Other discs and goals, as they come.
function showTried({ trying, log }) {
  byId("tried-title").hidden = !trying && !log.tried.length;
  const lines = log.tried.map(({ what, located, enough, command }) => make("li", { title: command }, `${what}: ${located}${enough ? "" : ", which is too few"}`));
  byId("tried").replaceChildren(...lines, ...(trying ? [make("li", {}, "Trying the next one in the background ...")] : []));
}

function showParts({ name, log: { parts } }) {
  if (byId("film").dataset.plan !== name) byId("film").hidden = true;
  byId("film").dataset.plan = name;
  byId("parts").hidden = byId("parts-title").hidden = !parts.length;
  const located = parts.filter((part) => part.outcome === "LEAF").length, within = parts.filter((part) => part.within).length;
  byId("tally").textContent = parts.length ? `${parts.length} parts: ${located} located, ${within} within the goal. Choose one to see it squeezed.` : "";
  byId("parts").querySelector("tbody").replaceChildren(...parts.map((part) => {
    const button = make("button", { type: "button", "aria-label": `Show part ${part.number}`, id: `part-${part.number}` }, String(part.number));
    button.addEventListener("click", attempt(() => showFilm(name, part.number)));
    const cells = [button, part.outcome, part.widths, part.place, part.angle, part.error].map((cell) => make("td", {}, cell));
    return make("tr", part.within ? {} : { class: "off" }, ...cells);
  }));
}

form.addEventListener("input", ({ target }) => {
  if (target.value === "") delete touched[target.name];
  else touched[target.name] = target.value;
  if (target.name === "gripper" && preview?.gripper !== target.value) delete touched.radius;
  soon();
});
form.addEventListener("submit", attempt(async () => {
  begun = (await ask("/plan", { drawing }, settings())).plan;
  await refresh();
  byId("plan").scrollIntoView({ block: "start" });
  byId("plan-title").focus({ preventScroll: true }); // the button is disabled
}));
byId("view").addEventListener("settled", soon);
byId("stop").addEventListener("click", attempt(async () => (await ask("/stop", { plan: byId("plans").value }, "{}"), await refresh())));
byId("plans").addEventListener("change", attempt(async () => ((known = ""), await refresh())));
byId("drawing").addEventListener("change", attempt(() => choose(byId("drawing").value)));
byId("file").addEventListener("change", attempt(() => add(byId("file").files[0])));
for (const kind of ["dragover", "dragleave", "drop"]) {
  document.addEventListener(kind, (event) => {
    event.preventDefault();
    byId("drop").classList.toggle("over", kind === "dragover");
  });
}
document.addEventListener("drop", attempt((event) => add(event.dataTransfer.files[0])));

async function follow() {
  let busy = false;
  try {
    if (!document.hidden) busy = await refresh();
    if (lost) {
      lost = false;
      tell();
      await look(); // its answer may have been lost
    }
  } catch (error) {
    lost = true;
    tell(error.message);
  }
  setTimeout(follow, busy ? BUSY_MS : IDLE_MS);
}
follow();

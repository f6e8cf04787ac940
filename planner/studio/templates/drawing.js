// Pictures to scale, in mm: y points up. `shape` is of elements.js.

const LEAST_MM = 0.5, MOST_MM = 100, STEP_MM = 0.5, MARGIN = 1.12, GRID_MM = 10;
const PICTURE_PX = 380; // about how wide the picture is: what the handle's size goes by

export function contourPicture(contour) {
  const room = 0.06 * Math.max(contour.width_mm, contour.height_mm);
  const box = `${-room} ${-contour.height_mm - room} ${contour.width_mm + 2 * room} ${contour.height_mm + 2 * room}`;
  const part = shape("polygon", { points: contour.points, class: "part", transform: "scale(1 -1)" });
  return shape("svg", { viewBox: box, "aria-hidden": "true" }, part);
}

export function nearestRadius(mm) {
  return Math.min(MOST_MM, Math.max(LEAST_MM, Math.round(mm / STEP_MM) * STEP_MM));
}

export function radiusAfter(key, radius, fast) {
  const step = (fast ? 10 : 1) * STEP_MM;
  const steps = { ArrowRight: step, ArrowUp: step, ArrowLeft: -step, ArrowDown: -step, PageUp: 10 * STEP_MM, PageDown: -10 * STEP_MM };
  if (key === "Home") return LEAST_MM;
  if (key === "End") return MOST_MM;
  return key in steps ? nearestRadius(radius + steps[key]) : null;
}

// Draws what `preview` tells into an SVG; `moved` is called with each radius that a person chooses.
export function drawPart(view, preview, moved) {
  view.classList.remove("moving");
  const { hand, datum } = preview, half = hand.opening_mm / 2;
  const extent = MARGIN * Math.max(half + hand.width_mm, preview.reach_mm, preview.radius_mm, hand.length_mm / 2);
  view.setAttribute("viewBox", `${-extent} ${-extent} ${2 * extent} ${2 * extent}`);
  const world = shape("g", { transform: "scale(1 -1)" });
  for (let at = -GRID_MM * Math.floor(extent / GRID_MM); at <= extent; at += GRID_MM) {
    world.append(shape("line", { x1: at, x2: at, y1: -extent, y2: extent, class: "grid" }));
    world.append(shape("line", { y1: at, y2: at, x1: -extent, x2: extent, class: "grid" }));
  }
  const turn = preview.turn_deg;
  if (turn === null || turn >= 180) world.append(shape("circle", { r: preview.reach_mm, class: "ghost" }));
  else if (turn > 0) for (const angle of [-turn, turn]) world.append(shape("polygon", { points: preview.outline, class: "ghost", transform: `rotate(${angle})` }));
  world.append(shape("polygon", { points: preview.outline, class: "part" }));
  for (const hole of preview.holes) world.append(shape("polygon", { points: hole, class: "hole" }));
  for (const y of [half, -half - hand.width_mm]) world.append(shape("rect", { x: -hand.length_mm / 2, y, width: hand.length_mm, height: hand.width_mm, class: "finger" }));
  const arm = extent / 25, { x_mm: x, y_mm: y } = datum;
  world.append(shape("path", { d: `M${x - arm} ${y}h${2 * arm}M${x} ${y - arm}v${2 * arm}`, class: "datum" }));
  const disc = shape("circle", { class: "disc" });
  const handle = shape("circle", { id: "handle", cy: 0, r: 2 * extent * 9 / PICTURE_PX, role: "slider", tabindex: 0, "aria-label": "Radius of the disc, mm", "aria-valuemin": LEAST_MM, "aria-valuemax": MOST_MM });
  world.append(disc, handle);

  let radius = preview.radius_mm;
  const show = () => {
    disc.setAttribute("r", radius);
    handle.setAttribute("cx", radius);
    handle.setAttribute("aria-valuenow", radius);
    handle.setAttribute("aria-valuetext", `${radius} mm`);
  };
  const move = (mm) => {
    if (mm === null || mm === radius) return;
    radius = mm;
    show();
    moved(radius);
  };
  handle.addEventListener("keydown", (event) => {
    const next = radiusAfter(event.key, radius, event.shiftKey);
    if (next !== null) event.preventDefault();
    move(next);
  });
  handle.addEventListener("pointerdown", (event) => {
    handle.setPointerCapture(event.pointerId);
    view.classList.add("moving");
  });
  handle.addEventListener("pointermove", (event) => {
    if (!handle.hasPointerCapture(event.pointerId)) return;
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(world.getScreenCTM().inverse());
    move(nearestRadius(Math.hypot(at.x, at.y)));
  });
  handle.addEventListener("lostpointercapture", () => {
    view.classList.remove("moving");
    view.dispatchEvent(new Event("settled"));
  });
  show();
  const focused = document.activeElement?.id === "handle";
  view.replaceChildren(world);
  if (focused) handle.focus();
}

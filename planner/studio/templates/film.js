// A simulated part as an animation: where hand and part are at a time, and what shows it.

const CLOSING_S = 1.2, SQUEEZE_S = 2, TICK_MS = 40;
const between = (from, to, share) => from + share * (to - from);
const turned = (degrees) => ((degrees + 180) % 360 + 360) % 360 - 180;
const placed = (pose) => `translate(${pose.x_mm} ${pose.y_mm})rotate(${pose.turn_deg})`;

export const lasts = (film) => SQUEEZE_S * film.squeezes.length;

// Width at which the first finger, both moving alike, touches an outline at a pose in the hand's frame.
export function touchWidth(outline, pose) {
  const turn = (pose.turn_deg * Math.PI) / 180;
  return 2 * Math.max(...outline.map((point) => Math.abs(pose.y_mm + point.x_mm * Math.sin(turn) + point.y_mm * Math.cos(turn))));
}

// Number of the squeeze, the hand's place, the width, and the part's pose in the hand's frame.
export function momentOf(film, seconds) {
  const number = Math.min(Math.floor(seconds / SQUEEZE_S), film.squeezes.length - 1);
  const { before, after, hand, opening_mm, width_mm } = film.squeezes[number];
  const width = between(opening_mm, width_mm, Math.min((seconds - number * SQUEEZE_S) / CLOSING_S, 1));
  const touch = Math.min(touchWidth(film.outline, before), opening_mm);
  const share = touch > width_mm ? Math.min(Math.max((touch - width) / (touch - width_mm), 0), 1) : 0;
  const turn = between(before.turn_deg, before.turn_deg + turned(after.turn_deg - before.turn_deg), share);
  const part = { x_mm: between(before.x_mm, after.x_mm, share), y_mm: between(before.y_mm, after.y_mm, share), turn_deg: turn };
  return { number, hand, width, part };
}

export function drawMoment(view, film, seconds) {
  const { hand: gripper, outline, squeezes, reach_mm } = film, { number, hand, width, part } = momentOf(film, seconds);
  const off = Math.max(...squeezes.map((each) => Math.hypot(each.hand.x_mm, each.hand.y_mm)));
  const extent = off + Math.max(reach_mm, gripper.opening_mm / 2 + gripper.width_mm) + 2;
  view.setAttribute("viewBox", `${-extent} ${-extent} ${2 * extent} ${2 * extent}`);
  const finger = (y) => shape("rect", { class: "finger", x: -gripper.length_mm / 2, y, width: gripper.length_mm, height: gripper.width_mm });
  const shown = shape("polygon", { class: "part", points: outline.map((point) => `${point.x_mm},${point.y_mm}`).join(" "), transform: placed(part) });
  const world = shape("g", { transform: `scale(1 -1)${placed(hand)}` }, shown, finger(width / 2), finger(-width / 2 - gripper.width_mm));
  view.replaceChildren(world);
  return `Squeeze ${number + 1} of ${squeezes.length}: ${width.toFixed(1)} mm apart`;
}

// Shows films in some elements of the page; a person who wants no motion begins it by hand.
export function projector({ view, slider, button, caption }) {
  let film = null;
  const show = (seconds) => (caption.textContent = drawMoment(view, film, seconds));
  const { play, pause } = player({ slider, button, step: TICK_MS / 1000, milliseconds: TICK_MS, show });
  return (next) => {
    pause();
    film = next;
    slider.max = lasts(film);
    slider.value = 0;
    show(0);
    if (!matchMedia("(prefers-reduced-motion: reduce)").matches) play();
  };
}

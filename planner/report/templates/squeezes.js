const data = JSON.parse(byId("data").textContent), {opening_mm: opening, length_mm: length, thickness_mm: thickness, upper_share: share} = data.jaws, {x: halfX, y: halfY} = data.half;
const slider = document.querySelector("input"), button = document.querySelector("button");
const place = ({x, y, turn}) => `translate(${x} ${y}) rotate(${turn * 180 / Math.PI})`;
const points = list => list.map(({x, y}) => `${x},${y}`).join(" ");

const panels = data.squeezes.map(({status, states}, number) => {
  const box = {class: "finger", x: -length / 2, width: length, height: thickness};
  const start = shape("polygon", {class: "before", points: data.outline, transform: place(states[0])});
  const upper = shape("rect", box), lower = shape("rect", box), trace = shape("polyline", {class: "trace"});
  const part = shape("polygon", {class: "part", points: data.outline}), caption = make("figcaption");
  const world = shape("g", {transform: "scale(1 -1)"}, start, upper, lower, part, trace);
  const svg = shape("svg", {class: "scene", viewBox: `${-halfX} ${-halfY} ${2 * halfX} ${2 * halfY}`, role: "img", "aria-label": `Squeeze ${number + 1}`}, world);
  byId("squeezes").append(make("figure", {}, svg, caption));
  return step => {
    const now = states[step], width = now.width, top = opening / 2 - share * (opening - width);
    part.setAttribute("transform", place(now));
    upper.setAttribute("y", top);
    lower.setAttribute("y", top - width - thickness);
    trace.setAttribute("points", points(states.slice(0, step + 1)));
    const end = step === states.length - 1;
    caption.textContent = `${number + 1}  ${end ? status + ", " + width.toFixed(2) : width.toFixed(1)} mm`;
  };
});

slider.max = data.squeezes[0].states.length - 1;
const show = step => panels.forEach(panel => panel(step));
player({slider, button, step: 1, milliseconds: 50, show});
show(0);

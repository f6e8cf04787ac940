"""The page of moving squeezes: inline SVG, a slider, no network. `@NAMES@` are filled in by `animation`."""

PAGE = """\
<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width">
<title>@TITLE@</title>
<style>
body { font: 14px/1.4 system-ui, sans-serif; color: #1a1a1a }
body { max-width: 1100px; margin: 1.5em auto; padding: 0 1em }
h1 { font-size: 1.2em; font-weight: 600 }
#bar { position: sticky; top: 0; background: #fff; display: flex; gap: 1em; padding: .5em 0 }
#bar input { flex: 1 }
#squeezes { display: grid; grid-template-columns: repeat(auto-fill, minmax(230px, 1fr)); gap: 1em }
figure { margin: 0 }
figcaption { text-align: center; font-variant-numeric: tabular-nums }
svg { width: 100%; border: 1px solid #d9d9d9; border-radius: 4px }
svg * { vector-effect: non-scaling-stroke; fill: none }
.start { stroke: @GREY@ }
.part { stroke: @BLUE@; stroke-width: 1.5; fill: @BLUE@; fill-opacity: .2 }
.finger { stroke: @RED@; fill: @RED@; fill-opacity: .2 }
.trace { stroke: @BLUE@ }
</style>
</head>
<body>
<h1>@TITLE@</h1>
<div id="bar"><button type="button">play</button>
<input type="range" min="0" value="0" aria-label="progress">
</div>
<div id="squeezes"></div>
<script>
"use strict";
const data = @DATA@;
const [opening, length, thickness, share] = data.jaws;
const [halfX, halfY] = data.half;
const slider = document.querySelector("input"), button = document.querySelector("button");
const place = ([x, y, turn]) => `translate(${x} ${y}) rotate(${turn * 180 / Math.PI})`;
const points = list => list.map(([x, y]) => `${x},${y}`).join(" ");

function shape(parent, name, kind, attributes) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  element.setAttribute("class", kind);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  return parent.appendChild(element);
}

const panels = data.squeezes.map(({status, states}, number) => {
  const figure = document.createElement("figure");
  document.getElementById("squeezes").append(figure);
  const svg = shape(figure, "svg", "", {viewBox: `${-halfX} ${-halfY} ${2 * halfX} ${2 * halfY}`});
  const world = shape(svg, "g", "", {transform: "scale(1 -1)"});
  const outline = {points: points(data.outline)};
  const box = {x: -length / 2, width: length, height: thickness};
  shape(world, "polygon", "start", {...outline, transform: place(states[0])});
  const upper = shape(world, "rect", "finger", box), lower = shape(world, "rect", "finger", box);
  const part = shape(world, "polygon", "part", outline);
  const trace = shape(world, "polyline", "trace", {});
  const caption = document.createElement("figcaption");
  figure.append(caption);
  return step => {
    const now = states[step], width = now[3], top = opening / 2 - share * (opening - width);
    part.setAttribute("transform", place(now));
    upper.setAttribute("y", top);
    lower.setAttribute("y", top - width - thickness);
    trace.setAttribute("points", points(states.slice(0, step + 1)));
    const end = step === states.length - 1;
    caption.textContent = `${number + 1}  ${end ? status + ", " + width.toFixed(2) : width.toFixed(1)} mm`;
  };
});

const last = data.squeezes[0].states.length - 1;
let timer = 0;
slider.max = last;
const show = () => panels.forEach(panel => panel(Number(slider.value)));
const stop = () => { clearInterval(timer); timer = 0; button.textContent = "play"; };
const advance = () => {
  slider.value = Number(slider.value) + 1;
  show();
  if (Number(slider.value) === last) stop();
};
slider.addEventListener("input", () => { stop(); show(); });
button.addEventListener("click", () => {
  if (timer) return stop();
  if (Number(slider.value) === last) slider.value = 0;
  button.textContent = "stop";
  timer = setInterval(advance, 50);
});
show();
</script>
</body>
</html>
"""

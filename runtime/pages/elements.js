"use strict";
const byId = id => document.getElementById(id);
function fill(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}
const make = (name, attributes = {}, ...children) => fill(document.createElement(name), attributes, children);
const shape = (name, attributes = {}, ...children) => fill(document.createElementNS("http://www.w3.org/2000/svg", name), attributes, children);
// Plays an animation: `slider` holds the moment, `show(moment)` draws it.
function player({slider, button, step, milliseconds, show}) {
  let timer = 0;
  const now = () => Number(slider.value), last = () => Number(slider.max);
  const pause = () => { clearInterval(timer); timer = 0; button.textContent = "Play"; };
  const play = () => {
    if (now() >= last()) slider.value = 0;
    button.textContent = "Pause";
    timer = setInterval(() => {
      slider.value = now() + step;
      show(now());
      if (now() >= last()) pause();
    }, milliseconds);
  };
  button.addEventListener("click", () => { if (timer) pause(); else play(); });
  slider.addEventListener("input", () => { pause(); show(now()); });
  return {play, pause};
}

// A button that does something to robots: it takes two clicks within 3 s, or one press of 0.7 s. Enter twice does it, too.
// What a hand does without meaning it does nothing: a double click, a key that is held.

import { el, put, say } from "./dom.js";

const AGAIN = 3000; // ms within which the second click counts
const PRESS = 700; // ms
const APART = 350; // ms that must lie between the two clicks
const REST = 1000; // ms after an order in which clicks do nothing

export function confirmed({ text, again, title, act, class: kind }) {
  const word = el("span", {}, text);
  const button = el("button", { type: "button", class: `confirm ${kind ?? ""}`, title, "data-title": title }, word, el("i", { "aria-hidden": true }));
  let armed = 0, pressed = 0, done = false, since = 0, ordered = -REST;

  const disarm = () => {
    clearTimeout(armed);
    armed = 0;
    put(button, "data-state", null);
    say(word, text);
  };
  const arm = () => {
    put(button, "data-state", "armed");
    say(word, again);
    since = performance.now();
    armed = setTimeout(disarm, AGAIN);
  };
  const go = () => {
    disarm();
    ordered = performance.now();
    put(button, "data-state", "sent");
    setTimeout(() => button.dataset.state === "sent" && put(button, "data-state", null), 600);
    act();
  };
  const let_go = () => {
    clearTimeout(pressed);
    pressed = 0;
    put(button, "data-press", null);
  };
  const refused = () => button.getAttribute("aria-disabled") === "true";

  button.addEventListener("pointerdown", (event) => {
    done = false;
    if (event.button !== 0 || refused()) return;
    put(button, "data-press", true);
    pressed = setTimeout(() => {
      let_go();
      done = true;
      go();
    }, PRESS);
  });
  for (const end of ["pointerup", "pointerleave", "pointercancel"]) button.addEventListener(end, let_go);
  button.addEventListener("keydown", (event) => event.repeat && event.preventDefault()); // else each makes a click
  button.addEventListener("click", (event) => {
    event.stopPropagation();
    if (done) {
      done = false; // the press has done it
    } else if (refused()) {
      button.dispatchEvent(new CustomEvent("refused", { bubbles: true, detail: button.dataset.why }));
    } else if (performance.now() - ordered < REST) {
      return;
    } else if (armed) {
      if (performance.now() - since >= APART) go();
    } else {
      arm();
    }
  });
  button.addEventListener("blur", () => armed && disarm());
  return button;
}

// The mind of the selected agent.

import { el, keyed, put, say, span } from "./dom.js";

const shown = new WeakMap();

export function render(element, view, actions) {
  let parts = shown.get(element);
  if (!parts) shown.set(element, (parts = make(element)));
  const mind = view.mind;
  say(parts.age, mind ? `cycle ${mind.cycle ?? 0}, seen ${span(view.now() - view.heard)} ago` : view.there ? "asking …" : "it is not there");
  put(parts.age, "class", view.silent ? "bad" : "dim");
  list(parts.intentions, mind?.intentions ?? [], (one) => one.id, (one) => `${(one.stack ?? []).join(" ‹ ")}  ${one.state} ${one.reason ?? ""} ${one.at ?? ""}`);
  list(parts.events, mind?.events ?? [], (one, index) => index, (one) => one.text);
  list(parts.beliefs, mind?.beliefs ?? [], (one) => one.text, (one) => one.text);
}

function make(element) {
  const parts = { age: el("p", { class: "dim" }) };
  element.append(parts.age);
  for (const name of ["intentions", "events", "beliefs"]) element.append(el("h3", {}, name), (parts[name] = el("ul", { class: "plain data" })));
  return parts;
}

function list(parent, items, keyOf, textOf) {
  keyed(parent, items.map((one, index) => [keyOf(one, index), one]), ([key]) => key, () => el("li", {}), (row, [, one]) => say(row, textOf(one)));
}

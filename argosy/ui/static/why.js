// Why the selected agent did what it did.

import { clock, el, keyed, put, say } from "./dom.js";

const shown = new WeakMap();

export function render(element, view, actions) {
  let parts = shown.get(element);
  if (!parts) shown.set(element, (parts = make(element)));
  parts.ask = actions.ask;
  say(parts.told, view.busy ? "asking …" : view.error ? view.error : view.asked ? `asked at ${clock(view.asked)}` : "");
  put(parts.told, "class", view.error ? "bad" : "dim");
  const lines = (view.explanation?.paragraphs ?? []).flatMap((one) => [...(one.lines ?? []), { text: "" }]);
  keyed(parts.lines, lines.map((line, index) => [index, line]), ([index]) => index, () => el("li", {}), (row, [, line]) => {
    say(row, line.text ?? "");
    row.style.paddingLeft = `${(line.indent ?? 0) * 1.2}em`;
  });
}

function make(element) {
  const parts = { told: el("p", { class: "dim" }), lines: el("ul", { class: "plain data" }) };
  const input = el("input", { class: "data", placeholder: "goal, belief or action; nothing: what happened last", "aria-label": "why what?" });
  const form = el("form", { class: "line", on: { submit: (event) => {
    event.preventDefault();
    parts.ask(input.value.trim());
  } } }, input, el("button", { type: "submit" }, "why"));
  element.append(form, parts.told, parts.lines);
  return parts;
}

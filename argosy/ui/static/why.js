// Why the selected agent did, or did not do, something: the sentences of `argosy why`, one card for each thing.

import { clock, el, keyed, put, say } from "./dom.js";

const KINDS = { decision: ["◆", "decided"], failure: ["✕", "failed"], dropped: ["⊘", "dropped"], question: ["?", "asked"], now: ["▶", "now"], plan: ["☰", "in its program"], belief: ["●", "believed"], action: ["▸", "did"], hint: ["ⓘ", "hint"] };
const shown = new WeakMap();

export function render(element, view, actions) {
  let pane = shown.get(element);
  if (!pane) shown.set(element, (pane = new Why(element)));
  pane.render(view, actions);
}

class Why {
  constructor(element) {
    this.input = el("input", { type: "search", class: "data grow", placeholder: "a goal, belief or action; nothing: what it does now", "aria-label": "why what?", autocomplete: "off", spellcheck: "false" });
    const form = el("form", { class: "line why-form", on: { submit: (event) => {
      event.preventDefault();
      this.actions?.ask(this.input.value.trim());
    } } }, el("span", { class: "dim" }, "why"), this.input, el("button", { type: "submit" }, "ask"));
    this.told = el("p", { class: "dim", role: "status" });
    this.cards = el("div", { class: "cards" });
    element.append(form, this.told, this.cards);
  }

  render(view, actions) {
    this.actions = actions;
    if (view.name !== this.name || (view.about !== this.about && document.activeElement !== this.input)) this.input.value = view.about ?? "";
    this.name = view.name;
    this.about = view.about;
    this.later = view.later ?? 0; // seconds by which the clock of the fleet is ahead of the clock of this mind
    const about = view.about ? `why ${view.about}: ` : "";
    say(this.told, view.busy ? `${about}asking …` : view.error ? `${about}${view.error}` : view.asked ? `${about}asked at ${view.asked}` : "");
    put(this.told, "class", view.error && !view.busy ? "bad" : "dim");
    put(this.cards, "data-old", view.busy || Boolean(view.error) ? "true" : null);
    const cards = (view.explanation?.paragraphs ?? []).map((one, place) => ({ ...one, place }));
    keyed(this.cards, cards, (one) => `${one.place} ${one.kind}`, () => this._make(), (card, one) => this._update(card, one, view.explanation));
  }

  _make() {
    const card = el("section", { class: "card" });
    card.sign = el("span", { class: "sign" });
    card.kind = el("span", { class: "kind" });
    card.times = el("span", { class: "age" });
    card.lines = el("ul", {});
    card.append(el("div", { class: "line" }, card.sign, card.kind, el("span", { class: "grow" }), card.times), card.lines);
    return card;
  }

  _update(card, one, explanation) {
    const [sign, kind] = KINDS[one.kind] ?? ["·", one.kind];
    say(card.sign, sign);
    say(card.kind, kind);
    put(card, "data-kind", one.kind);
    const at = one.time === undefined || one.time === null ? "" : `${(one.time + this.later).toFixed(1)} s`;
    say(card.times, [one.times > 1 ? `${one.times} times` : "", at].filter(Boolean).join(", "));
    put(card.times, "title", at ? `second of the mission; it was ${((explanation.time ?? 0) + this.later).toFixed(1)} s when asked` : null);
    const lines = (one.lines ?? []).map((line, place) => ({ ...line, place }));
    keyed(card.lines, lines, (line) => line.place, () => this._line(), (row, line) => {
      row.style.setProperty("--depth", line.indent ?? 0);
      this._say(row, line);
    });
  }

  _line() {
    return el("li", { class: "said" });
  }

  // The sentence; where it names its place in the program, that is a button.
  _say(row, line) {
    const text = line.text ?? "";
    if (row.said === text && row.at === line.position) return;
    row.said = text;
    row.at = line.position;
    const place = line.position ?? "";
    const short = place.split("/").at(-1);
    const found = place ? [place, short].find((one) => one && text.includes(one)) : undefined;
    const button = place ? el("button", { type: "button", class: "link data place", title: `${place}: copy`, on: { click: () => this.actions.source(place) } }, found ?? short) : null;
    if (!found) {
      row.replaceChildren(text, ...(button ? [" ", button] : []));
      return;
    }
    const at = text.indexOf(found);
    row.replaceChildren(text.slice(0, at), button, text.slice(at + found.length));
  }
}

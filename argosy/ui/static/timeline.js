// What happened, the newest at the bottom: prints, actions, mail, who came and went; by kind, by agent, by words.

import { clock, count, el, keyed, put, say } from "./dom.js";
import { missionSeconds } from "./time.js";
import { toneOf } from "./tones.js";

const KINDS = {
  actions: ["action", "outcome"],
  mail: ["sent", "received", "undelivered"],
  prints: ["print"],
  logs: ["log"],
  fleet: ["came", "went", "report", "operator"],
};
const SIGNS = { action: "▸", outcome: "▪", print: "“", log: "≡", sent: "", received: "", undelivered: "✕", operator: "!", came: "+", went: "−", report: "·" };
const ROWS = 300;
const HAND = 1500; // ms for which the list goes on after a hand has moved it

export class Timeline {
  constructor(element, actions) {
    this._actions = actions;
    this._off = new Set(["logs"]);
    this.search = el("input", { type: "search", placeholder: "find …", "aria-label": "find in what happened", on: { input: () => this._all() } });
    this.one = el("input", { type: "checkbox", on: { change: () => this._all() } });
    this.oneName = el("span", {});
    this.kinds = Object.keys(KINDS).map((kind) =>
      el("button", { type: "button", class: "toggle", "aria-pressed": String(!this._off.has(kind)), "data-kind": kind, on: { click: (event) => this._toggle(kind, event.currentTarget) } }, kind),
    );
    this.newer = el("button", { type: "button", class: "newer", hidden: true, on: { click: () => this._down() } });
    this.list = el("ol", { class: "events" });
    this.scroll = el("div", { class: "scroll", tabindex: "0", "aria-label": "timeline", on: { scroll: () => this._scrolled() } }, this.list);
    this.bar = el("div", { class: "bar sub" }, ...this.kinds, el("label", { class: "only" }, this.one, "only ", this.oneName), this.search);
    this.missed = el("p", { class: "missed warn", hidden: true });
    element.append(this.bar, this.missed, this.scroll, this.newer);
    // Only a hand moves it away from the newest: rows that get their size scroll it, too.
    for (const kind of ["wheel", "touchmove", "pointerdown", "keydown"]) this.scroll.addEventListener(kind, () => (this._hand = performance.now()), { passive: true });
    const size = new ResizeObserver(() => this._bottom && this._down());
    size.observe(this.scroll);
    size.observe(this.list);
    this._hand = -HAND;
    this._bottom = true;
    this._seen = 0;
  }

  render(wire, changed, selected) {
    this._wire = wire;
    const other = selected !== this._selected;
    this._selected = selected;
    say(this.oneName, selected ?? "the selected agent");
    put(this.missed, "hidden", wire.leftOut === 0);
    say(this.missed, `${count(wire.leftOut, "event")} did not come here: too many at once, or while this page was away`);
    if (!changed.has("events") && !other) return;
    if (other && this.one.checked) this._bottom = true;
    this._all();
  }

  _all() {
    if (!this._wire) return;
    const kinds = new Set(Object.entries(KINDS).filter(([kind]) => !this._off.has(kind)).flatMap(([, all]) => all));
    const words = this.search.value.toLowerCase();
    const agent = this.one.checked ? this._selected : null;
    const robot = agent ? this._wire.get(`agent/${agent}`)?.robot : null;
    const shown = [];
    for (let index = this._wire.events.length - 1; index >= 0 && shown.length < ROWS; index -= 1) {
      const event = this._wire.events[index];
      if (!kinds.has(event.what)) continue;
      if (agent && ![event.who, event.other].some((one) => one && (one === agent || one === robot))) continue;
      if (words && !`${event.who} ${event.text}`.toLowerCase().includes(words)) continue;
      shown.push(event);
    }
    shown.sort((one, other) => one.at - other.at || one.number - other.number); // what an agent did is published some time later
    keyed(this.list, shown, (event) => event.number, (event) => this._row(event), (row, event) => say(row.firstChild, this._time(event)));
    const newest = shown.reduce((most, event) => Math.max(most, event.number), 0);
    if (this._bottom) this._down();
    else {
      const more = shown.filter((event) => event.number > this._seen).length;
      put(this.newer, "hidden", more === 0);
      say(this.newer, `↓ ${more} newer`);
    }
    if (this._bottom) this._seen = newest;
  }

  // By the clock of the run in which it happened; what happened before that was known, by the one of this run.
  _time(event) {
    const seconds = event.mission ?? missionSeconds(this._wire, event.at);
    return seconds === null ? clock(event.at) : seconds.toFixed(1);
  }

  _row(event) {
    const robot = this._wire.get(`agent/${event.who}`)?.robot ?? event.who;
    const row = el("li", { class: `event is-${event.level ?? "info"} of-${event.what}`, "data-n": event.number, title: `${clock(event.at)} (wall)` },
      el("span", { class: "at" }),
      el("button", { class: "who", type: "button", style: { "--tone": toneOf(robot) }, on: { click: () => this._actions.select(event.who, null) } }, event.who),
      el("span", { class: "sign", "aria-hidden": true }, SIGNS[event.what] ?? "·"),
      el("span", { class: "text data" }, event.text),
    );
    if (event.what === "action" || event.what === "outcome") row.append(el("button", { class: "link", type: "button", on: { click: () => this._actions.why(event.who, event.text.split("(")[0].split(" ")[0]) } }, "why"));
    return row;
  }

  _toggle(kind, button) {
    if (!this._off.delete(kind)) this._off.add(kind);
    put(button, "aria-pressed", String(!this._off.has(kind)));
    this._all();
  }

  _scrolled() {
    if (this._bottom && performance.now() - this._hand > HAND) return;
    this._bottom = this.scroll.scrollHeight - this.scroll.scrollTop - this.scroll.clientHeight < 24;
    if (this._bottom) put(this.newer, "hidden", true);
  }

  _down() {
    this.scroll.scrollTop = this.scroll.scrollHeight;
    this._bottom = true;
  }
}

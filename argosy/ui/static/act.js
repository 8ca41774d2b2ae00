// What an operator may do to a mind, where the mission allows it: pause it, step, resume, give it a goal or a belief.

import { clock, el, keyed, put, say } from "./dom.js";

const DONE = 8; // of what was ordered, kept per agent

export class Act {
  constructor(element, actions) {
    this._actions = actions;
    this._done = new Map();
    this.why = el("p", { class: "hint" });
    const control = (order, text, title) => el("button", { type: "button", "data-do": order, title, on: { click: (event) => event.currentTarget.getAttribute("aria-disabled") !== "true" && this._order(order, "") } }, text);
    this.pause = control("pause", "❚❚ pause", "let it reason no more; it goes on by itself after a while if it is forgotten");
    this.step = control("step", "▸❚ step", "run one cycle of the paused mind");
    this.resume = control("resume", "▶ resume", "let it reason again");
    this.goal = this._field("goal", "achieve a goal", "go(3,4)", "give goal");
    this.belief = this._field("belief", "add a belief", "wind(strong)", "tell belief");
    this.log = el("ul", { class: "acts" });
    element.append(this.why, el("div", { class: "line" }, this.pause, this.step, this.resume), this.goal.form, this.belief.form, el("p", { class: "dim" }, "As the program would write it; a belief gets the source `operator`."), this.log);
    this.buttons = [this.pause, this.step, this.resume, this.goal.button, this.belief.button];
  }

  _field(order, label, placeholder, text) {
    const input = el("input", { class: "data", id: `act-${order}`, placeholder, autocomplete: "off", spellcheck: "false", maxlength: "4000" });
    const button = el("button", { type: "submit", "data-do": order }, text);
    const form = el("form", { class: "field", on: { submit: (event) => {
      event.preventDefault();
      if (button.getAttribute("aria-disabled") !== "true" && input.value.trim()) this._order(order, input.value.trim());
    } } }, el("label", { for: `act-${order}` }, label), el("div", { class: "line" }, input, button));
    return { form, button };
  }

  render(agent, control) {
    this._agent = agent.name;
    this._control = control;
    say(this.why, control.allowed ? "" : `Not allowed: ${control.why}`);
    put(this.why, "hidden", control.allowed);
    for (const button of this.buttons) put(button, "aria-disabled", control.allowed ? null : "true");
    put(this.step, "aria-disabled", control.allowed && agent.state === "paused" ? null : "true");
    put(this.resume, "aria-disabled", control.allowed && agent.state === "paused" ? null : "true");
    keyed(this.log, this._done.get(agent.name) ?? [], (one) => one.number, () => el("li", { class: "data" }), (row, one) => {
      say(row, `${clock(one.at)} (wall)  ${one.order}${one.text && ` ${one.text}`}: ${one.result}`);
      put(row, "class", `data ${one.kind}`);
    });
  }

  async _order(order, text) {
    const name = this._agent;
    if (!this._control?.allowed) return;
    const one = { number: (this._number = (this._number ?? 0) + 1), at: Date.now() / 1000, order, text, told: "…", kind: "calm" };
    this._done.set(name, [one, ...(this._done.get(name) ?? [])].slice(0, DONE));
    const answer = await this._actions.control(name, order, text);
    one.result = answer.ok ? `done${answer.reason ? `: ${answer.reason}` : ""}` : `NOT done: ${answer.reason}`;
    one.kind = answer.ok ? "good" : "bad";
    this._actions.again();
  }
}

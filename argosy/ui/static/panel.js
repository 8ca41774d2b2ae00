// The selected agent: its mind, why it did what it did, and what an operator may do to it.

import { el, put, say } from "./dom.js";
import { allow, orderButtons } from "./head.js";
import { Act } from "./act.js";
import { how, howClass } from "./agents.js";
import { render as renderMind } from "./mind.js";
import { render as renderWhy } from "./why.js";
import { ago, asOf, missionSeconds, moment, speedOf } from "./time.js";
import { hasEnded, isThere, stateOf } from "./tones.js";

const TABS = { mind: "Mind", why: "Why", act: "Act" };

export class Panel {
  constructor(element, actions) {
    this._actions = actions;
    this.name = el("h2", { class: "data" });
    this.state = el("span", { class: "state" });
    this.file = el("span", { class: "dim data" });
    this.robot = el("div", { class: "line robotline" });
    this.how = el("span", { class: "how data" });
    this.stops = el("span", { class: "stops", role: "group" });
    this.robot.append(this.how, el("span", { class: "grow" }), this.stops);
    this.tabs = Object.fromEntries(Object.entries(TABS).map(([tab, text]) => [tab, el("button", { type: "button", role: "tab", id: `tab-${tab}`, "aria-controls": `pane-${tab}`, on: { click: () => this.show(tab), keydown: (event) => this._move(event) } }, text)]));
    this.panes = Object.fromEntries(Object.keys(TABS).map((tab) => [tab, el("div", { class: `scroll ${tab}`, role: "tabpanel", id: `pane-${tab}`, "aria-labelledby": `tab-${tab}`, tabindex: "0" })]));
    this.none = el("p", { class: "empty" }, "Select an agent to see its mind.");
    this.body = el("div", { class: "body" }, el("div", { class: "title line" }, this.name, this.state, this.file, el("span", { class: "grow" }), el("button", { type: "button", class: "ghost", title: "larger or smaller", "aria-label": "larger or smaller", on: { click: () => actions.enlarge("panel") } }, "⤢")), this.robot, el("div", { class: "tabs", role: "tablist" }, ...Object.values(this.tabs)), ...Object.values(this.panes));
    element.append(this.none, this.body);
    this.act = new Act(this.panes.act, actions);
    this._asked = new Map(); // agent -> what was asked why, and the answer
    this.tab = "mind";
    this.show(actions.tab ?? "mind");
  }

  show(tab) {
    this.tab = tab;
    for (const [one, button] of Object.entries(this.tabs)) {
      put(button, "aria-selected", String(one === tab));
      put(button, "tabindex", one === tab ? "0" : "-1");
      put(this.panes[one], "hidden", one !== tab);
    }
    this._actions.tabbed(tab);
    if (this._wire) this.render(this._wire, new Set(), this._agent);
    if (tab === "why" && this._agent && !this._asked.has(this._agent)) this.why("");
  }

  render(wire, changed, name) {
    const other = name !== this._agent;
    this._wire = wire;
    this._agent = name;
    const agent = name ? wire.get(`agent/${name}`) : null;
    put(this.none, "hidden", Boolean(agent));
    put(this.body, "hidden", !agent);
    if (!agent) return;
    const [sign, kind, word] = stateOf(agent);
    say(this.name, name);
    say(this.state, `${sign} ${word}${agent.silent ? ` for ${ago(wire, agent.silent)}` : ""}`);
    put(this.state, "class", `state ${kind}`);
    put(this.state, "title", agent.why_silent || word);
    say(this.file, [agent.program?.split("/").at(-1), agent.board && `on ${agent.board}`].filter(Boolean).join(" "));
    put(this.file, "title", agent.program);
    this._robot(wire, agent);
    if (other && this.tab === "why" && !this._asked.has(name)) this.why("");
    this._pane(wire, agent);
  }

  _robot(wire, agent) {
    const robot = agent.robot ? wire.get(`robot/${agent.robot}`) : null;
    put(this.robot, "hidden", !robot);
    if (!robot) return;
    if (this._buttonsOf !== robot.name) {
      this._buttonsOf = robot.name;
      this.stops.replaceChildren(...orderButtons(this._actions, robot.name));
    }
    for (const button of this.stops.children) allow(button, wire.get("head")?.observer);
    say(this.how, `${robot.name}  ${how(robot, wire)}`);
    put(this.how, "title", this.how.textContent);
    put(this.how, "class", `how data ${howClass(robot)}`);
  }

  _pane(wire, agent) {
    const head = wire.get("head");
    const actions = {
      why: (about) => this._actions.why(agent.name, about),
      ask: (about) => this.why(about),
      agent: (name) => this._actions.select(name, null),
      source: (position) => this._actions.source(position),
    };
    if (this.tab === "mind") {
      const told = wire.get(`mind/${agent.name}`);
      const clock = { now: () => asOf(wire), speed: speedOf(wire), ago: (at) => ago(wire, at), mission: (at) => missionSeconds(wire, at) };
      renderMind(this.panes.mind, { name: agent.name, mind: told?.mind ?? null, heard: told?.heard ?? null, plans: wire.get(`plans/${agent.name}`), clock, there: isThere(agent) || hasEnded(agent), silent: Boolean(agent.silent) }, actions);
    } else if (this.tab === "why") {
      const asked = this._asked.get(agent.name) ?? { about: "", busy: false, error: "", explanation: null, asked: null };
      const zero = asked.explanation?.time === undefined ? null : missionSeconds(wire, asked.asked); // of the fleet's clock when its mind's was `time`
      renderWhy(this.panes.why, { name: agent.name, ...asked, asked: asked.asked && moment(wire, asked.asked), later: zero === null ? 0 : zero - asked.explanation.time }, actions);
    } else {
      this.act.render(agent, controlOf(head, agent));
    }
  }

  async why(about) {
    const name = this._agent;
    if (!name) return;
    const before = this._asked.get(name);
    this._asked.set(name, { about, busy: true, error: "", explanation: before?.explanation ?? null, asked: before?.asked ?? null });
    this.render(this._wire, new Set(), this._agent);
    const answer = await this._wire.post("/why", { agent: name, about });
    const error = answer.error ?? answer.reason ?? "";
    this._asked.set(name, { about, busy: false, error, explanation: answer.explanation ?? null, asked: this._wire.now() });
    this.render(this._wire, new Set(), this._agent);
  }

  _move(event) {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step) return;
    const tabs = Object.keys(TABS);
    const next = tabs[(tabs.indexOf(this.tab) + step + tabs.length) % tabs.length];
    this.show(next);
    this.tabs[next].focus();
  }
}

// Whether minds take orders, as far as it is known beforehand; an agent may refuse all the same, and says why.
function controlOf(head, agent) {
  if (head?.observer) return { allowed: false, why: head.observer };
  if (head?.inject === false) return { allowed: false, why: "the mission does not say `inject: true`: its minds take no orders" };
  if (hasEnded(agent)) return { allowed: false, why: `${agent.name} has ended with its run` };
  if (!isThere(agent)) return { allowed: false, why: `${agent.name} is not there` };
  return { allowed: true, why: "" };
}

// The mind of the selected agent: what it intends, does, believes and has decided. Records as in docs/reference/records.md.

import { count, el, keyed, put, say, shortened, span } from "./dom.js";
import { awaited } from "./tones.js";

const PARTS = ["intentions", "actions", "events", "questions", "beliefs", "decisions", "plans", "prints", "dropped"];
const CLOSED = new Set(["plans"]);
const SIGNS = { running: "▶", waiting: "…", suspended: "⏸", ended: "✓", failed: "✕", dropped: "⊘", none: "∅" };
const shown = new WeakMap();

export function render(element, view, actions) {
  let pane = shown.get(element);
  if (!pane) shown.set(element, (pane = new Mind(element)));
  pane.render(view, actions);
}

class Mind {
  constructor(element) {
    this.state = el("p", { class: "mind-state" });
    this.filter = el("input", { type: "search", class: "data", placeholder: "find in this mind …", "aria-label": "find in this mind", on: { input: () => this.render(this.view, this.actions) } });
    this.young = el("button", { type: "button", class: "toggle", "aria-pressed": "false", title: "beliefs: the youngest first", on: { click: () => this._sort() } }, "youngest first");
    element.append(this.state, el("div", { class: "line mind-bar" }, this.filter, this.young));
    this.parts = Object.fromEntries(PARTS.map((name) => [name, new Part(name)]));
    element.append(...Object.values(this.parts).map((part) => part.box));
    this.none = el("p", { class: "empty" });
    element.append(this.none);
  }

  _sort() {
    put(this.young, "aria-pressed", String(this.young.getAttribute("aria-pressed") !== "true"));
    this.render(this.view, this.actions);
  }

  render(view, actions) {
    if (!view) return;
    if (view.name !== this.view?.name) this.filter.value = "";
    this.view = view;
    this.actions = actions;
    const mind = view.mind;
    say(this.none, mind ? "" : view.there ? "Its mind has not answered yet." : "It is not running, and its mind has not answered.");
    for (const part of Object.values(this.parts)) put(part.box, "hidden", !mind);
    put(this.filter.parentElement, "hidden", !mind);
    say(this.state, mind ? stateOf(view, mind) : "");
    put(this.state, "class", `mind-state ${view.silent || !view.there ? "bad" : mind?.state === "paused" ? "warn" : "dim"}`);
    if (!mind) return;
    // by the agent's own clock, which begins with the agent: as it was when the mind was seen, and what has passed since
    this.now = (mind.time ?? 0) + Math.max(0, view.clock.now() - view.heard) * view.clock.speed;
    this.later = (view.clock.mission(view.clock.now()) ?? this.now) - this.now;
    const words = this.filter.value.toLowerCase().split(/\s+/).filter(Boolean);
    this.fits = (text) => words.every((word) => text.toLowerCase().includes(word));
    for (const name of PARTS) this[`_${name}`](this.parts[name], mind);
  }

  _intentions(part, mind) {
    const all = (mind.intentions ?? []).filter((one) => this.fits([...(one.stack ?? []), awaited(one.waits_for), one.at].join(" ")));
    part.list(all, mind.intentions_left_out, (one) => one.id, () => this._intention(), (node, one) => {
      node.tone(one.state);
      say(node.head, `#${one.id} ${[one.state, awaited(one.waits_for)].filter(Boolean).join(" ")}`);
      say(node.age, one.since === undefined ? "" : span(this.now - one.since));
      const goals = [...(one.stack ?? [])].reverse().map((goal, depth) => ({ goal, depth, top: depth === one.stack.length - 1 }));
      keyed(node.stack, goals, (goal) => `${goal.depth} ${goal.goal}`, (goal) => this._goal(goal.goal), (row, goal) => {
        row.style.setProperty("--depth", Math.min(goal.depth, 12));
        this._place(row.place, goal.top ? one.at : "");
      });
    });
  }

  _intention() {
    const node = el("li", { class: "intention" });
    node.sign = el("span", { class: "sign" });
    node.head = el("span", { class: "grow" });
    node.age = el("span", { class: "age" });
    node.stack = el("ul", { class: "stack" });
    node.tone = (state) => {
      say(node.sign, SIGNS[state] ?? "·");
      put(node, "data-state", state);
    };
    node.append(el("div", { class: "line dim" }, node.sign, node.head, node.age), node.stack);
    return node;
  }

  // A goal or event with its buttons: why, and where.
  _goal(text) {
    const row = el("li", { class: "goal" }, el("span", { class: "data grow" }, text));
    row.place = el("button", { type: "button", class: "link data place", on: { click: () => this.actions.source(row.place.dataset.at) } });
    row.append(row.place, this._why(text));
    return row;
  }

  _why(text) {
    const about = functor(text);
    return el("button", { type: "button", class: "link ask", title: `why ${about}?`, "aria-label": `why ${about}?`, on: { click: () => this.actions.why(about) } }, "why");
  }

  _place(button, position) {
    put(button, "hidden", !position);
    if (!position) return;
    put(button, "data-at", position);
    put(button, "title", `${position}: copy`);
    say(button, position.split("/").at(-1));
  }

  _actions(part, mind) {
    const ends = new Map((mind.actions ?? []).filter((one) => one.kind === "outcome").map((one) => [one.id, one]));
    const asked = (mind.actions ?? []).filter((one) => one.kind === "action" && this.fits(one.text)).reverse();
    part.list(asked, 0, (one) => one.id, (one) => this._line(one.text), (row, one) => {
      const end = ends.get(one.id);
      const state = end?.state || "running";
      say(row.sign, state === "succeeded" ? "✓" : state === "running" ? "▶" : "✕");
      put(row, "data-state", state === "succeeded" ? "ended" : state === "running" ? "running" : "failed");
      say(row.text, `${one.text ?? ""}${end?.reason ? `  ${state}: ${end.reason}` : end ? `  ${state}` : ""}`);
      const took = (end?.time ?? this.now) - (one.time ?? 0);
      say(row.age, end ? `took ${span(took)}, ${span(this.now - end.time)} ago` : span(took));
    });
  }

  _line(about) {
    const row = el("li", { class: "line entry" });
    row.sign = el("span", { class: "sign" });
    row.text = el("span", { class: "data grow" });
    row.age = el("span", { class: "age" });
    row.append(row.sign, row.text, row.age);
    if (about) row.append(this._why(about));
    return row;
  }

  _events(part, mind) {
    const all = (mind.events ?? []).map((one, place) => ({ ...one, place })).filter((one) => this.fits(one.text));
    part.list(all, mind.events_left_out, (one) => `${one.place} ${one.text}`, (one) => this._line(one.text), (row, one) => {
      say(row.sign, `${one.place + 1}`);
      say(row.text, one.text);
      say(row.age, one.intention ? `for #${one.intention}` : "new");
    });
    if (mind.mailbox) say(part.more, `${part.more.textContent}${part.more.textContent ? "; " : ""}${count(mind.mailbox, "message")} to be read`);
  }

  _questions(part, mind) {
    const all = (mind.questions ?? []).filter((one) => this.fits(`${one.receiver} ${one.performative} ${one.content}`));
    part.list(all, 0, (one) => one.id, (one) => this._line(one.content), (row, one) => {
      say(row.sign, "?");
      say(row.text, `${one.receiver}: ${one.performative} ${one.content}`);
      const left = one.until === undefined ? "for ever" : this.now > one.until ? "time is up" : `${span(one.until - this.now)} left`;
      say(row.age, `${span(this.now - one.asked)}, ${left}`);
      put(row, "title", `#${one.intention ?? 0} asks at ${one.position ?? "?"}`);
    });
  }

  _beliefs(part, mind) {
    const all = (mind.beliefs ?? []).filter((one) => this.fits(one.text));
    if (this.young.getAttribute("aria-pressed") === "true") all.sort((one, other) => (other.since ?? -1) - (one.since ?? -1));
    part.list(all, mind.beliefs_left_out, (one) => one.text, (one) => this._belief(one), (row, one) => {
      const [text, more] = apart(one.text);
      say(row.text, text + more);
      keyed(row.sources, one.sources ?? [], (name) => name, (name) => this._source(name));
      say(row.age, one.since === undefined ? "?" : span(this.now - one.since));
      put(row.age, "title", one.since === undefined ? "nobody knows since when" : `since ${(one.since + this.later).toFixed(1)} s`);
      put(row, "data-young", one.since !== undefined && this.now - one.since < 3);
    });
  }

  _belief(one) {
    const row = this._line(one.text);
    row.classList.add("belief");
    row.sources = el("span", { class: "sources" });
    row.sign.remove();
    row.age.before(row.sources);
    return row;
  }

  _source(name) {
    if (name === "self" || name === "percept" || name === "operator") return el("span", { class: `source of-${name}` }, name);
    return el("button", { type: "button", class: "source of-agent", title: `told by ${name}`, on: { click: () => this.actions.agent(name) } }, name);
  }

  _decisions(part, mind) {
    const decided = (mind.decisions ?? []).map((one) => ({ ...one, of: "decision" }));
    const told = new Set(decided.filter((one) => one.failure).map((one) => `${one.failure.cycle} ${one.failure.formula}`));
    const failed = (mind.failures ?? []).filter((one) => !told.has(`${one.cycle} ${one.formula}`)).map((one) => ({ ...one, of: "failure" }));
    const numbers = new Map();
    const all = [...decided, ...failed].sort((one, other) => one.cycle - other.cycle).map((one) => {
      const name = `${one.cycle} ${one.of} ${one.event ?? one.formula}`;
      numbers.set(name, (numbers.get(name) ?? 0) + 1);
      return { ...one, key: `${name} ${numbers.get(name)}` };
    }).filter((one) => this.fits(`${one.event ?? ""} ${one.formula ?? ""} ${one.outcome ?? ""}`)).reverse();
    part.list(all, 0, (one) => one.key, (one) => this._decision(one), (row, one) => {
      const outcome = one.of === "failure" ? "failed" : one.outcome ?? "none";
      say(row.sign, SIGNS[outcome] ?? "·");
      put(row, "data-state", outcome);
      put(row.sign, "title", outcome === "none" ? "no plan was applicable" : outcome);
      say(row.age, `${span(this.now - one.time)} ago`);
      const lines = one.of === "failure" ? failureLines(one) : decisionLines(one);
      keyed(row.lines, lines.map((line, index) => ({ ...line, index })), (line) => line.index, () => this._told(), (said, line) => {
        say(said.text, line.text);
        put(said, "class", `line ${line.kind ?? ""}`);
        this._place(said.place, line.at);
      });
    });
  }

  _decision(one) {
    const text = one.event ?? one.formula;
    const row = el("details", { class: "entry decision" });
    row.sign = el("span", { class: "sign" });
    row.age = el("span", { class: "age" });
    row.lines = el("ul", { class: "told" });
    row.append(el("summary", { class: "line" }, row.sign, el("span", { class: "data grow", title: text }, shortened(text, 120)), row.age, this._why(one.event ?? one.given_up?.[0] ?? text)), row.lines);
    return wrapped(row);
  }

  _told() {
    const row = el("li", { class: "line" });
    row.text = el("span", { class: "grow" });
    row.place = el("button", { type: "button", class: "link data place", on: { click: () => this.actions.source(row.place.dataset.at) } });
    row.append(row.text, row.place);
    return row;
  }

  _plans(part, mind) {
    const plans = this.view.plans ?? mind.plans ?? [];
    const all = plans.map((one, place) => ({ ...one, place })).filter((one) => this.fits(`${one.label ?? ""} ${one.trigger} ${one.context ?? ""}`));
    part.list(all, Math.max(0, (mind.plan_count ?? plans.length) - plans.length), (one) => `${one.place} ${one.position} ${one.trigger}`, (one) => {
      const row = el("details", { class: "entry plan" });
      row.place = el("button", { type: "button", class: "link data place", on: { click: () => this.actions.source(row.place.dataset.at) } });
      row.append(el("summary", { class: "line" }, el("span", { class: "data grow" }, `${one.label ? `@${one.label} ` : ""}${one.trigger}${one.context ? ` : ${one.context}` : ""}`), row.place, this._why(one.trigger)), el("pre", { class: "data" }, one.source ?? ""));
      this._place(row.place, one.position);
      return wrapped(row);
    });
  }

  _prints(part, mind) {
    const all = (mind.prints ?? []).map((text, place) => ({ text, place })).filter((one) => this.fits(one.text)).reverse();
    part.list(all, 0, (one) => `${one.place} ${one.text}`, (one) => el("li", { class: "data" }, one.text));
  }

  _dropped(part, mind) {
    const all = (mind.drops ?? []).filter((one) => this.fits(`${one.what} ${one.name ?? ""}`));
    put(part.box, "hidden", all.length === 0 && !Object.keys(mind.dropped ?? {}).length);
    part.list(all, 0, (one) => `${one.what} ${one.name ?? ""}`, (one) => this._line(one.what === "events" ? one.name : ""), (row, one) => {
      say(row.sign, "⊘");
      put(row, "data-state", "failed");
      say(row.text, `${one.count} ${one.what}${one.name ? ` ${one.name}` : ""}${one.reason ? `: ${one.reason}` : ""}`);
      say(row.age, `${span(this.now - one.last)} ago`);
    });
  }
}

// A part of the mind that can be folded; it says how much it holds, and how much is left out.
class Part {
  constructor(name) {
    this.count = el("span", { class: "dim" });
    this.rows = el("ul", { class: "plain rows-of" });
    this.more = el("p", { class: "dim" });
    this.box = el("details", { class: "part", "data-part": name, open: !CLOSED.has(name) }, el("summary", {}, el("h3", {}, name), this.count), this.rows, this.more);
  }

  list(items, leftOut, keyOf, make, update) {
    const left = leftOut ?? 0;
    say(this.count, items.length + left ? String(items.length + left) : "none");
    say(this.more, left ? `${left} more are not shown` : "");
    if (this.box.open || this.rows.childElementCount) keyed(this.rows, this.box.open ? items : [], keyOf, make, update);
    if (!this.box.open) this.box.ontoggle = () => this.list(items, leftOut, keyOf, make, update);
  }
}

function wrapped(row) {
  const item = el("li", {}, row);
  for (const name of ["sign", "age", "lines", "place"]) item[name] = row[name];
  return item;
}

function stateOf(view, mind) {
  const told = [`cycle ${mind.cycle ?? 0}`, mind.state ?? "waiting"];
  if (mind.state === "paused" && mind.paused_for !== undefined) told.push(`goes on by itself in ${span(mind.paused_for - (view.clock.now() - view.heard))} (wall)`);
  told.push(`${(view.clock.mission(view.heard) ?? mind.time ?? 0).toFixed(1)} s of the mission`, `seen ${view.clock.ago(view.heard)} ago`);
  return told.join(" · ");
}

// "visit" of "+!visit(1)[source(self)]"
function functor(text) {
  return String(text ?? "").replace(/^[-+^!?~@]+/, "").split(/[([\s:;,]/)[0];
}

// A belief without its sources, which are shown beside it, and its other annotations.
function apart(text) {
  const at = text.lastIndexOf("[");
  if (at <= 0 || !text.endsWith("]")) return [text, ""];
  const others = text.slice(at + 1, -1).split(",").filter((one) => !/^source\([\w.]+\)$/.test(one));
  if (others.some((one) => /source\(/.test(one) || (one.match(/\(/g) ?? []).length !== (one.match(/\)/g) ?? []).length)) return [text, ""];
  return [text.slice(0, at), others.length ? `[${others.join(",")}]` : ""];
}

function planName(plan) {
  return `${plan.label ? `@${plan.label} ` : ""}${plan.trigger}`;
}

function bindings(plan) {
  const all = Object.entries(plan.bindings ?? {});
  return all.length ? ` with ${all.map(([name, value]) => `${name} = ${value}`).join(", ")}` : "";
}

function causeText(cause) {
  switch (cause.kind) {
    case "message": return `message ${cause.performative} from ${cause.sender}${cause.message ? ` (${cause.message})` : ""}`;
    case "told": return `what ${cause.sender} told`;
    case "percept": return "a percept";
    case "program": return "the program";
    case "outside": return "outside: an operator, the mission or a restart";
  }
  return `intention ${cause.intention}`;
}

function decisionLines(one) {
  const lines = [];
  const from = one.goal ? `raised by the plan for ${one.goal}` : one.cause ? `from ${causeText(one.cause)}` : "";
  if (from || one.asked_at) lines.push({ text: from || "asked for", at: one.asked_at, kind: "dim" });
  for (const plan of one.rejected ?? []) lines.push({ text: `✕ ${planName(plan.plan)}: ${plan.message || plan.why}`, at: plan.plan.position, kind: "rejected" });
  if (one.chosen) lines.push({ text: `✓ ${planName(one.chosen)}${bindings(one.chosen)}`, at: one.chosen.position, kind: "chosen" });
  else lines.push({ text: (one.rejected ?? []).length ? "no plan was applicable" : "there is no plan for it", kind: "bad" });
  for (const plan of one.untried ?? []) lines.push({ text: `not needed: ${planName(plan)}`, at: plan.position, kind: "dim" });
  if (one.failure) lines.push(...failureLines(one.failure));
  if (one.dropped_by) lines.push({ text: `dropped by ${one.dropped_by}`, at: one.dropped_at, kind: "bad" });
  return lines;
}

function failureLines(one) {
  const lines = [{ text: `${one.formula} failed: ${one.error}${one.reason ? `: ${one.reason}` : ""}`, at: one.position, kind: "bad" }];
  if (one.given_up?.length) lines.push({ text: `given up: ${one.given_up.join(", ")}`, kind: "dim" });
  lines.push({ text: one.handled_by ? `goes on with ${one.handled_by}` : "nothing handles it", kind: "dim" });
  return lines;
}

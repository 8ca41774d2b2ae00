// The page of `argosy ui`: its parts are drawn when what they show has changed, and once a second for ages.

import { el, put } from "./dom.js";
import { Agents } from "./agents.js";
import { FleetMap } from "./map.js";
import { Head } from "./head.js";
import { SequenceChart } from "./sequence_chart.js";
import { Orders } from "./orders.js";
import { Panel } from "./panel.js";
import { Timeline } from "./timeline.js";
import { Wire } from "./wire.js";
import { byName, isThere } from "./tones.js";

const byId = (id) => document.getElementById(id);
const [first, tab] = decoded(location.hash.slice(1)).split("/");
let selected = first || null;
let pending = new Set();
let drawing = 0;
const failing = new Map(); // part of the page -> why it was not drawn last

const actions = {
  tab,
  select(agent, robot) {
    if (robot && !agent) return;
    if (!wire.get(`agent/${agent}`)) return;
    selected = agent;
    wire.look([agent]);
    note();
    draw(new Set());
  },
  tabbed(name) {
    actions.tab = name;
    note();
  },
  why(agent, about) {
    actions.select(agent, null);
    panel.show("why");
    panel.why(about);
  },
  async stop(order, robot) {
    const asked = orders.asked(`${order} ${robot ?? "all"}`, wire.stamp());
    draw(new Set());
    const answer = await wire.post("/stop", { order, at: asked.at, robots: robot ? [robot] : null });
    orders.answered(asked, answer);
    draw(new Set());
  },
  async control(agent, action, text) {
    const answer = await wire.post("/control", { agent, do: action, text, at: wire.stamp() });
    return { ok: answer.ok === true, reason: answer.reason ?? "" };
  },
  async fleet(name) {
    await wire.post("/fleet", { fleet: name });
  },
  source(position) {
    navigator.clipboard?.writeText(position).then(() => orders.note(`${position} is copied`, "calm"), () => undefined);
  },
  enlarge(name) {
    const main = byId("main");
    put(main, "data-large", main.dataset.large === name ? null : name);
  },
  again() {
    draw(new Set());
  },
};

function decoded(text) {
  try {
    return decodeURIComponent(text);
  } catch {
    return ""; // somebody wrote it by hand
  }
}

function note() {
  const place = `#${encodeURIComponent(selected ?? "")}/${actions.tab ?? "mind"}`;
  if (location.hash !== place) history.replaceState(null, "", place);
}

// The timeline and the mail chart share a place.
function course(element) {
  const panes = { timeline: el("div", { class: "body", id: "timeline" }), mail: el("div", { class: "body", id: "mail" }) };
  const buttons = Object.keys(panes).map((name) => el("button", { type: "button", role: "tab", id: `tab-${name}`, "aria-controls": name, on: { click: () => show(name) } }, name === "mail" ? "Mail" : "Timeline"));
  const show = (name) => {
    for (const button of buttons) put(button, "aria-selected", String(button.id === `tab-${name}`));
    for (const [one, pane] of Object.entries(panes)) put(pane, "hidden", one !== name);
    if (wire) draw(new Set(["events"]));
  };
  element.append(el("div", { class: "tabs", role: "tablist" }, ...buttons, el("span", { class: "grow" }), el("button", { type: "button", class: "ghost", title: "larger or smaller", "aria-label": "larger or smaller", on: { click: () => actions.enlarge("course") } }, "⤢")), panes.timeline, panes.mail);
  queueMicrotask(() => show("timeline"));
  return panes;
}

const head = new Head(byId("head"), byId("banners"), actions);
const agents = new Agents(byId("agents"), actions);
const map = new FleetMap(byId("map"), actions);
const orders = new Orders(byId("orders"));
let wire = null;
const panes = course(byId("course"));
const timeline = new Timeline(panes.timeline, actions);
const sequenceChart = new SequenceChart(panes.mail, actions);
const panel = new Panel(byId("panel"), actions);
document.addEventListener("refused", (event) => orders.note(event.detail));

function draw(changed) {
  for (const key of changed) pending.add(key);
  if (drawing) return;
  drawing = requestAnimationFrame(() => {
    drawing = 0;
    const now = pending;
    pending = new Set();
    paint(now);
  });
}

function paint(changed) {
  if (!selected || !wire.get(`agent/${selected}`)) {
    const there = wire.of("agent").sort((one, other) => byName(one.name, other.name));
    const one = there.find(isThere) ?? null;
    if (one && (!selected || wire.silentFor === 0)) selected = one.name;
  }
  if (selected) wire.look([selected]);
  put(document.body, "data-old", wire.problem || !["up", "ended"].includes(wire.get("head")?.router ?? "never") ? "true" : null);
  const wrong = [];
  // What cannot be drawn is said, and takes nothing else with it; orders and the header come first.
  const part = (name, render) => {
    try {
      render();
    } catch (error) {
      wrong.push(`${name} cannot be drawn: ${error.message}. What stands there may be old`);
      if (failing.get(name) !== error.message) console.warn(name, error);
      failing.set(name, error.message);
    }
  };
  part("orders", () => orders.render(wire));
  part("the list", () => agents.render(wire, selected));
  part("the map", () => map.render(wire, changed, selected));
  if (!panes.timeline.hidden) part("the timeline", () => timeline.render(wire, changed, selected));
  if (!panes.mail.hidden) part("the mail", () => sequenceChart.render(wire, changed, selected));
  part("the panel", () => panel.render(wire, changed, selected));
  head.render(wire, wrong);
}

document.addEventListener("keydown", (event) => {
  if (event.key === "/" && !/^(INPUT|TEXTAREA|SELECT)$/.test(document.activeElement?.tagName ?? "")) {
    event.preventDefault();
    byId("search").focus();
  }
});
wire = new Wire((changed) => draw(changed));
setInterval(() => draw(new Set()), 1000); // ages

// The map: vehicles with track, target and home, victims, waypoints and areas, on tiles or on a plain grid in metres.

import { el, put, say, shortened } from "./dom.js";
import { ago } from "./time.js";
import { byName, hasEnded, isLeft, isThere, toneOf } from "./tones.js";

const L = window.L;
const METRES = 111320; // of a degree of latitude
const MOST_POINTS = 2000; // of a track
const STEP = 0.5; // m that a vehicle moves before its track gets a point
const LETTER = 6.2; // px of a character of a label, about
const CROWD = 12; // with more vehicles, only the chosen one tells all on its label

export class FleetMap {
  constructor(element, actions) {
    this._actions = actions;
    const canvas = el("div", { class: "canvas", tabindex: "0", "aria-label": "map" });
    this.scale = el("span", { class: "scale" });
    this.cursor = el("span", { class: "cursor dim" });
    const button = (text, title, act) => el("button", { type: "button", title, "aria-label": title, on: { click: act } }, text);
    this.follow = button("◎", "keep everything in view", () => this._fit());
    const tools = el("div", { class: "tools" }, button("+", "closer", () => this.map.zoomIn()), button("−", "farther", () => this.map.zoomOut()), this.follow, button("⤢", "larger or smaller", () => actions.enlarge("map")));
    const legend = el("div", { class: "legend" }, el("span", { class: "mark victim missing" }, "▲"), "missing", el("span", { class: "mark victim promised" }, "▲"), "promised", el("span", { class: "mark victim rescued" }, "✓"), "rescued", el("span", { class: "mark target" }, "✛"), "target", el("span", { class: "mark home" }, "⌂"), "home");
    this.empty = el("p", { class: "empty" }, "no vehicle has reported its position");
    this.legend = legend;
    element.append(canvas, tools, el("div", { class: "under" }, this.scale, legend, this.cursor), this.empty);
    this.map = L.map(canvas, { zoomControl: false, attributionControl: false, preferCanvas: true, zoomSnap: 0.25, maxZoom: 23, minZoom: 3, wheelPxPerZoomLevel: 90, fadeAnimation: false });
    this.map.setView([0, 0], 3);
    this.grid = L.layerGroup().addTo(this.map);
    this.areas = L.layerGroup().addTo(this.map);
    this.vehicles = new Map();
    this.marks = new Map();
    this.fitting = true;
    this._origin = null;
    this.map.on("moveend", () => this._grid());
    this.map.on("zoomend moveend", () => this._declutter());
    this.map.on("zoomstart", () => canvas.classList.add("zooming"));
    this.map.on("zoomend", () => canvas.classList.remove("zooming"));
    this.map.on("dragstart", () => this._own());
    canvas.addEventListener("wheel", () => this._own(), { passive: true });
    this.map.on("mousemove", (event) => this._tell(event.latlng));
    new ResizeObserver(() => this.map.invalidateSize({ animate: false })).observe(canvas);
  }

  render(wire, changed, selected) {
    const head = wire.get("head");
    if (head?.tiles && !this._tiles) this._tiles = L.tileLayer("/tiles/{z}/{x}/{y}.png", { maxNativeZoom: 19, maxZoom: 23 }).addTo(this.map);
    const robots = wire.of("robot").sort((one, other) => byName(one.name, other.name));
    const placed = robots.filter((robot) => robot.position ?? robot.home);
    put(this.empty, "hidden", placed.length > 0);
    if (!this._origin && placed.length) this._origin = placed[0].home ?? placed[0].position;
    if (changed.has("tracks")) for (const vehicle of this.vehicles.values()) vehicle.begun = false;
    const targets = new Map();
    for (const mark of wire.get("marks")?.marks ?? []) if (mark.kind === "target") targets.set(mark.agents[0], mark);
    put(this.map.getContainer(), "data-crowd", robots.length > CROWD);
    for (const robot of placed) this._vehicle(robot, wire, targets, selected, robots.length > CROWD);
    for (const [name, vehicle] of this.vehicles) if (!placed.some((robot) => robot.name === name)) this._forget(name, vehicle);
    if (changed.has("marks") || !this._marked) this._marks(wire.get("marks"));
    if (this.fitting && placed.length) this._fit(wire);
    else this._declutter();
  }

  _vehicle(robot, wire, targets, selected, crowded) {
    let vehicle = this.vehicles.get(robot.name);
    if (!vehicle) this.vehicles.set(robot.name, (vehicle = this._make(robot)));
    if (!vehicle.begun) {
      vehicle.track.setLatLngs(wire.tracks.get(robot.name) ?? []);
      vehicle.begun = true;
    }
    const at = robot.position ?? robot.home;
    vehicle.marker.setLatLng(at);
    if (robot.position) this._trail(vehicle, robot.position);
    if (robot.home) {
      vehicle.home.setLatLng(robot.home).addTo(this.map);
      if (robot.radius) vehicle.fence.setLatLng(robot.home).setRadius(robot.radius).addTo(this.map);
    }
    const agents = robot.agents ?? [];
    const target = agents.map((agent) => targets.get(agent)).find(Boolean);
    vehicle.way.setLatLngs(target && robot.position ? [robot.position, target.position] : []);
    const chosen = agents.includes(selected);
    const old = robot.lost || robot.stale || isLeft(robot) || !(isThere(robot) || hasEnded(robot));
    put(vehicle.icon, "class", `vessel${chosen ? " chosen" : ""}${old ? " old" : ""}${robot.armed ? " armed" : ""}`);
    const heading = robot.heading ?? vehicle.course; // without a compass: where it went last
    const turned = heading !== undefined && (robot.heading !== undefined || robot.armed);
    say(vehicle.body, turned ? "➤" : "●");
    vehicle.body.style.transform = turned ? `rotate(${heading - 90}deg)` : "";
    const height = robot.altitude === undefined ? "" : `${robot.altitude.toFixed(1)} m`;
    const age = robot.lost ? "LOST" : isLeft(robot) ? "when its bridge ended" : robot.stale ? `${ago(wire, robot.stale)} ago` : "";
    say(vehicle.title, robot.name);
    say(vehicle.more, crowded && !chosen ? age : [height, robot.mode, robot.operator && `OPERATOR ${robot.operator}`, robot.paused && "PAUSED", age].filter(Boolean).join(" · "));
    put(vehicle.icon, "title", `${robot.name} (${agents.join(", ")}) ${robot.mode ?? ""} ${height} ${robot.speed ?? 0} m/s`);
  }

  _make(robot) {
    const tone = toneOf(robot.name);
    const vehicle = { begun: false };
    vehicle.body = el("span", { class: "body" });
    vehicle.title = el("b", {});
    vehicle.more = el("span", {});
    vehicle.label = el("span", { class: "label data" }, vehicle.title, " ", vehicle.more);
    vehicle.icon = el("div", { class: "vessel", style: { "--tone": tone } }, vehicle.body, vehicle.label);
    vehicle.marker = L.marker([0, 0], { icon: L.divIcon({ html: vehicle.icon, className: "holder", iconSize: [0, 0] }), keyboard: false, zIndexOffset: 500 }).addTo(this.map);
    vehicle.marker.on("click", () => this._actions.select((robot.agents ?? [])[0] ?? null, robot.name));
    vehicle.track = L.polyline([], { color: tone, weight: 2, opacity: 0.6, interactive: false }).addTo(this.map);
    vehicle.way = L.polyline([], { color: tone, weight: 1.5, opacity: 0.9, dashArray: "4 5", interactive: false }).addTo(this.map);
    vehicle.home = L.marker([0, 0], { icon: L.divIcon({ html: el("span", { class: "mark home", title: `home of ${robot.name}`, style: { "--tone": tone } }, "⌂"), className: "holder", iconSize: [0, 0] }), keyboard: false, interactive: false });
    vehicle.fence = L.circle([0, 0], { radius: 1, color: tone, weight: 1, opacity: 0.5, dashArray: "2 6", fill: false, interactive: false });
    return vehicle;
  }

  _trail(vehicle, position) {
    const points = vehicle.track.getLatLngs();
    const last = points.at(-1);
    if (last && this.map.distance(last, position) < STEP) return;
    if (last) vehicle.course = courseOf(last, position);
    if (points.length >= MOST_POINTS) vehicle.track.setLatLngs(points.filter((_, index) => index % 2 === 0));
    vehicle.track.addLatLng(position);
  }

  _forget(name, vehicle) {
    for (const layer of [vehicle.marker, vehicle.track, vehicle.way, vehicle.home, vehicle.fence]) layer.remove();
    this.vehicles.delete(name);
  }

  _marks(told) {
    this._marked = true;
    const there = new Set();
    for (const mark of told?.marks ?? []) {
      there.add(mark.id);
      let shown = this.marks.get(mark.id);
      if (!shown) {
        const sign = el("span", {}), label = el("span", { class: "name data" });
        const node = el("span", { class: "mark" }, sign, label);
        shown = { node, sign, label, marker: L.marker(mark.position, { icon: L.divIcon({ html: node, className: "holder", iconSize: [0, 0] }), keyboard: false }).addTo(this.map) };
        this.marks.set(mark.id, shown);
      }
      shown.marker.setLatLng(mark.position);
      const state = (mark.state ?? "").split(" ")[0];
      put(shown.node, "class", `mark ${mark.kind} ${state}`);
      put(shown.node, "title", `${mark.kind} ${mark.label} ${mark.state ?? ""}\n${mark.text ?? ""}\n${(mark.agents ?? []).join(", ")}`);
      say(shown.sign, { victim: state === "rescued" ? "✓" : "▲", waypoint: "◆", target: "✛", place: "•" }[mark.kind]);
      say(shown.label, mark.kind === "target" ? "" : shortened(mark.label, 16));
    }
    for (const [id, shown] of this.marks) {
      if (there.has(id)) continue;
      shown.marker.remove();
      this.marks.delete(id);
    }
    put(this.legend, "hidden", there.size === 0 && this.vehicles.size === 0);
    const areas = JSON.stringify(told?.areas ?? []);
    if (areas === this._areasSeen) return;
    this._areasSeen = areas;
    this.areas.clearLayers();
    for (const { bounds: [south, west, north, east] } of told?.areas ?? []) {
      this.areas.addLayer(L.rectangle([[south, west], [north, east]], { className: "area", color: "#7a7a7a", weight: 1, fillOpacity: 0.06, interactive: false }));
    }
  }

  _own() {
    this.fitting = false;
    put(this.follow, "aria-pressed", "false");
  }

  // Show everything that there is, and keep it in view until the operator moves the map.
  _fit(wire = null) {
    if (!wire) this.fitting = true;
    put(this.follow, "aria-pressed", "true");
    const all = [];
    for (const vehicle of this.vehicles.values()) {
      all.push(vehicle.marker.getLatLng());
      if (this.map.hasLayer(vehicle.home)) all.push(vehicle.home.getLatLng());
      if (vehicle.way.getLatLngs().length) all.push(vehicle.way.getLatLngs()[1]);
    }
    for (const mark of this.marks.values()) all.push(mark.marker.getLatLng());
    this.areas.eachLayer((area) => all.push(area.getBounds().getSouthWest(), area.getBounds().getNorthEast()));
    if (!all.length) return;
    const bounds = L.latLngBounds(all);
    if (wire && this._fitted?.contains(bounds) && this.map.getBounds().contains(bounds)) return this._declutter();
    this._fitted = bounds.pad(0.12);
    this.map.fitBounds(bounds.pad(0.18), { maxZoom: 20.5, animate: false });
  }

  // Labels beside, below or above their vehicles, wherever none lies on another.
  _declutter() {
    const taken = [];
    const vehicles = [...this.vehicles.values()].map((vehicle) => ({ vehicle, at: this.map.latLngToContainerPoint(vehicle.marker.getLatLng()) }));
    for (const { at } of vehicles) taken.push([at.x - 9, at.y - 9, at.x + 9, at.y + 9]);
    for (const { vehicle, at } of vehicles) {
      const text = vehicle.label.textContent;
      const [width, height] = [text.length * LETTER + 10, 16]; // asking the browser would make it lay out the page
      const places = [[13, -height / 2], [-13 - width, -height / 2], [-width / 2, 12], [-width / 2, -12 - height], [13, 10], [13, -10 - height], [-13 - width, 10], [-13 - width, -10 - height], [13, 28], [13, -28 - height]];
      const size = this.map.getSize();
      const free = ([dx, dy]) => at.x + dx > 0 && at.x + dx + width < size.x && at.y + dy > 0 && at.y + dy + height < size.y && taken.every(([left, top, right, bottom]) => at.x + dx + width < left || at.x + dx > right || at.y + dy + height < top || at.y + dy > bottom);
      if (vehicle.place && free(vehicle.place)) vehicle.chosen = vehicle.place;
      else vehicle.chosen = places.find(free) ?? places[0];
      vehicle.place = vehicle.chosen;
      const [dx, dy] = vehicle.chosen;
      taken.push([at.x + dx, at.y + dy, at.x + dx + width, at.y + dy + height]);
      vehicle.label.style.transform = `translate(${Math.round(dx)}px, ${Math.round(dy)}px)`;
    }
  }

  // Lines every 1, 2 or 5 x 10^n metres from the first vehicle's home.
  _grid() {
    this.grid.clearLayers();
    if (!this._origin || this._tiles) return say(this.scale, "");
    const [south, north] = [this.map.getBounds().getSouth(), this.map.getBounds().getNorth()];
    const [west, east] = [this.map.getBounds().getWest(), this.map.getBounds().getEast()];
    const width = METRES * Math.cos((this._origin[0] * Math.PI) / 180); // of a degree of longitude
    const wanted = ((north - south) * METRES * 90) / Math.max(1, this.map.getSize().y); // m of 90 px
    const power = 10 ** Math.floor(Math.log10(wanted));
    const step = [1, 2, 5, 10].map((one) => one * power).find((one) => one >= wanted) ?? 10 * power;
    const line = (points, strong) => this.grid.addLayer(L.polyline(points, { color: "#808890", weight: strong ? 1.2 : 0.6, opacity: strong ? 0.5 : 0.35, interactive: false }));
    const rows = [Math.floor(((south - this._origin[0]) * METRES) / step), Math.ceil(((north - this._origin[0]) * METRES) / step)];
    const columns = [Math.floor(((west - this._origin[1]) * width) / step), Math.ceil(((east - this._origin[1]) * width) / step)];
    if (rows[1] - rows[0] > 100 || columns[1] - columns[0] > 200) return say(this.scale, "");
    for (let row = rows[0]; row <= rows[1]; row += 1) {
      const latitude = this._origin[0] + (row * step) / METRES;
      line([[latitude, west], [latitude, east]], row === 0);
    }
    for (let column = columns[0]; column <= columns[1]; column += 1) {
      const longitude = this._origin[1] + (column * step) / width;
      line([[south, longitude], [north, longitude]], column === 0);
    }
    say(this.scale, `grid ${step >= 1000 ? `${step / 1000} km` : `${step} m`}`);
  }

  _tell(at) {
    if (!this._origin) return;
    const width = METRES * Math.cos((this._origin[0] * Math.PI) / 180);
    const north = (at.lat - this._origin[0]) * METRES, east = (at.lng - this._origin[1]) * width;
    say(this.cursor, `${at.lat.toFixed(6)}, ${at.lng.toFixed(6)}   ${Math.abs(north).toFixed(0)} m ${north < 0 ? "S" : "N"} ${Math.abs(east).toFixed(0)} m ${east < 0 ? "W" : "E"}`);
  }
}

// Degrees from north, clockwise.
function courseOf(from, [latitude, longitude]) {
  return (Math.atan2((longitude - from.lng) * Math.cos((latitude * Math.PI) / 180), latitude - from.lat) * 180) / Math.PI;
}

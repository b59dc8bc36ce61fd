"use strict";
// What the other scripts share: the data, the state that the address keeps, SVG elements, axes.

window.onerror = (message, file, line) => {
  const box = document.getElementById("trouble");
  box.hidden = false;
  box.textContent = `This page has a fault: ${message} (line ${line})`;
};

const $ = (selector, within = document) => within.querySelector(selector);
const data = JSON.parse($("#data").textContent);

const DIGITS = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz-_";

// Numbers of `places` digits, full scale for 1.
function shares(text, places) {
  const values = [];
  for (let at = 0; at + places <= text.length; at += places) {
    let number = 0;
    for (let place = 0; place < places; place++) number = 64 * number + DIGITS.indexOf(text[at + place]);
    values.push(number / (64 ** places - 1));
  }
  return values;
}

const MOVES = [[0, 0], [0, 1], [1, 0], [0, -1], [-1, 0]];

// Poses [i, k, heading] of a walk.
function walk(text) {
  const colon = text.indexOf(":");
  if (colon < 0) return [];
  const poses = [text.slice(0, colon).split(",").map(Number)];
  for (const [step, di, dk, heading] of text.slice(colon + 1).matchAll(/\.(-?\d+),(-?\d+),(\d);|[\w-]/g)) {
    const [i, k] = poses[poses.length - 1], digit = DIGITS.indexOf(step);
    const move = di === undefined ? MOVES[digit >> 3] : [Number(di), Number(dk)];
    poses.push([i + move[0], k + move[1], di === undefined ? digit & 7 : Number(heading)]);
  }
  return poses;
}

const percent = (share) => `${(100 * share).toFixed(1)} %`;
const at = (list, index) => list[Math.min(index, list.length - 1)];

// An element; numbers in paths are shortened.
function svg(tag, attributes = {}, ...children) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}
function html(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}
const line = (points) => points.map(([x, y], n) => `${n ? "L" : "M"}${x.toFixed(1)} ${y.toFixed(1)}`).join("");

// How a row is drawn: 7 colours, then the same dashed, dotted, both.
const style = (row) => `row s${row % 7}`;
const dash = (row) => `d${Math.floor(row / 7) % 4}`;

// 1, 2 or 5 times a power of ten, for at most `most` ticks.
function stride(range, most) {
  let power = 10 ** Math.floor(Math.log10(range / most));
  for (;;) {
    const found = [1, 2, 5].find((n) => range / (n * power) <= most + 1e-9);
    if (found) return found * power;
    power *= 10;
  }
}

// A chart as wide as its place: the element, and functions from values to pixels.
function chart(place, height, [x0, x1, xName], [y0, y1, yName], format = (share) => Math.round(100 * share)) {
  const width = Math.max(260, place.clientWidth || 640), box = [52, 10, width - 10, height - 38];
  const x = (v) => box[0] + (box[2] - box[0]) * (v - x0) / (x1 - x0 || 1);
  const y = (v) => box[3] - (box[3] - box[1]) * (v - y0) / (y1 - y0 || 1);
  const root = svg("svg", { viewBox: `0 0 ${width} ${height}`, width, height, role: "img" });
  const ticks = (low, high, most) => {
    const step = stride(high - low || 1, most), found = [];
    for (let n = Math.ceil(low / step - 1e-9); n * step <= high + 1e-9; n++) found.push(n * step);
    return found;
  };
  for (const v of ticks(y0, y1, height > 250 ? 6 : 5)) {
    root.append(svg("path", { class: "grid", d: `M${box[0]} ${y(v).toFixed(1)}H${box[2]}` }));
    root.append(svg("text", { x: box[0] - 8, y: y(v) + 4, "text-anchor": "end" }, format(v)));
  }
  for (const v of ticks(x0, x1, width > 500 ? 10 : 5)) {
    root.append(svg("path", { class: "axis", d: `M${x(v).toFixed(1)} ${box[3]}v4` }));
    root.append(svg("text", { x: x(v), y: box[3] + 18, "text-anchor": "middle" }, x1 > 1 ? v : format(v)));
  }
  root.append(svg("path", { class: "axis", d: `M${box[0]} ${box[3]}H${box[2]}` }));
  root.append(svg("text", { x: (box[0] + box[2]) / 2, y: height - 3, "text-anchor": "middle" }, xName));
  const middle = (box[1] + box[3]) / 2;
  root.append(svg("text", { transform: `translate(10 ${middle}) rotate(-90)`, "text-anchor": "middle" }, yName));
  place.replaceChildren(root);
  return { root, x, y, box };
}

// The state: what is chosen, as numbers.
const state = {};

// The episodes of a row, as numbers.
const episodesOf = (set, row) => [...set.episodes.keys()].filter((n) => set.episodes[n][0] === row);

function read() {
  const asked = new URLSearchParams(location.hash.slice(1));
  const number = (names, key, otherwise) => {
    const found = names.indexOf(asked.get(key));
    return found < 0 ? otherwise : found;
  };
  state.set = number(data.sets.map((set) => set.name), "set", 0);
  state.count = number(data.counts, "count", 0);
  state.off = new Set(asked.getAll("off").map((name) => data.rows.indexOf(name)));
  const set = data.sets[state.set];
  if (!set) return;
  const last = (row) => at(shares(set.rows[row].curves[0][0], 3), Infinity) ?? -1;
  const order = [...data.rows.keys()].sort((a, b) => last(b) - last(a));
  state.row = number(data.rows, "row", order[0] ?? 0);
  state.x = number(data.rows, "x", data.reference);
  state.y = number(data.rows, "y", order.find((row) => row !== state.x) ?? state.x);
  state.by = asked.get("by") === "auc" ? "auc" : "final";
  // The episode that fits best what is asked for: scene before start before seed, else the best one.
  const scene = number(set.scenes.map((scene) => scene.name), "scene", -1);
  const fit = (n) => {
    const [, itsScene, start, seed] = set.episodes[n];
    const is = (key, value) => asked.has(key) && asked.get(key) === String(value);
    return 8 * (itsScene === scene) + 4 * is("start", start) + 2 * is("seed", seed) + (n === set.rows[state.row].picks[0]);
  };
  state.episode = episodesOf(set, state.row).reduce((best, n) => (best === undefined || fit(n) > fit(best) ? n : best), undefined);
  const step = Number.parseInt(asked.get("step"), 10);
  state.step = Number.isFinite(step) ? Math.max(0, Math.min(step, set.steps)) : set.steps;
}

function write() {
  const set = data.sets[state.set], episode = set.episodes[state.episode], kept = new URLSearchParams();
  kept.set("set", set.name);
  if (state.count) kept.set("count", data.counts[state.count]);
  kept.set("row", data.rows[state.row]);
  if (episode) {
    kept.set("scene", set.scenes[episode[1]].name);
    kept.set("start", episode[2]);
    kept.set("seed", episode[3]);
  }
  kept.set("step", state.step);
  kept.set("x", data.rows[state.x]);
  kept.set("y", data.rows[state.y]);
  if (state.by !== "final") kept.set("by", state.by);
  for (const row of state.off) if (row >= 0) kept.append("off", data.rows[row]);
  history.replaceState(null, "", `#${kept}`);
}

// Buttons of which one is pressed.
function choice(place, names, chosen, choose) {
  const button = (name, n) => {
    const element = html("button", { type: "button", "aria-pressed": n === chosen }, name);
    element.onclick = () => choose(n);
    return element;
  };
  place.replaceChildren(...names.map(button));
}

function options(select, names, chosen, choose) {
  select.replaceChildren(...names.map((name, n) => html("option", n === chosen ? { value: n, selected: "" } : { value: n }, name)));
  select.onchange = () => choose(Number(select.value));
}

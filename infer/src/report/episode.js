// One episode on the floor plan of its scene: the way so far, what was looked at, and its coverage.

let playing = null, stage = null;

function stop() {
  clearInterval(playing);
  playing = null;
  $(".play").textContent = "▶";
  $(".play").setAttribute("aria-label", "Play");
}

function drawEpisode() {
  const set = data.sets[state.set], [,, start, seed] = set.episodes[state.episode] ?? [];
  stop();
  drawControls(set, start, seed);
  const episode = set.episodes[state.episode];
  $(".walk").hidden = !episode;
  if (!episode) return;
  const [row, sceneNumber,,, bumps, metres, steps, curves] = episode;
  const scene = set.scenes[sceneNumber], poses = walk(steps), curve = shares(curves[state.count], 2);
  const place = ([i, k]) => [scene.lattice[0] - i * scene.lattice[2], scene.lattice[1] - k * scene.lattice[2]];
  stage = { poses, curve, places: poses.map(place), views: [], scene, walls: segments(scene.free), step: -1 };
  drawPlan(set, row);
  drawFacts(set, episode, bumps, metres);
  const last = poses.length - 1, slider = $(".player input");
  slider.max = last;
  state.step = Math.min(state.step, last);
  slider.value = state.step;
  slider.oninput = () => { stop(); show(Number(slider.value)); write(); };
  $(".play").onclick = () => play(last);
  show(state.step);
}

function drawControls(set, start, seed) {
  const mine = episodesOf(set, state.row), now = set.episodes[state.episode];
  const choose = (n) => { state.episode = n; state.step = set.steps; write(); drawEpisode(); };
  // Another row or scene keeps the rest as far as there is such an episode.
  const nearest = (row, scene) => {
    const fit = (n) => 4 * (set.episodes[n][1] === scene) + 2 * (set.episodes[n][2] === start) + (set.episodes[n][3] === seed);
    return episodesOf(set, row).reduce((best, n) => (best === undefined || fit(n) > fit(best) ? n : best), undefined);
  };
  options($("[name=row]"), data.rows, state.row, (row) => { state.row = row; choose(nearest(row, now?.[1])); });
  const scenes = [...new Set(mine.map((n) => set.episodes[n][1]))].sort((a, b) => a - b);
  const names = scenes.map((scene) => set.scenes[scene].name);
  options($("[name=scene]"), names, scenes.indexOf(now?.[1]), (n) => choose(nearest(state.row, scenes[n])));
  const here = mine.filter((n) => set.episodes[n][1] === now?.[1]);
  const seeds = new Set(here.map((n) => set.episodes[n][3])).size > 1;
  const name = (n) => `${set.episodes[n][2]}${seeds ? `, seed ${set.episodes[n][3]}` : ""}`;
  options($("[name=start]"), here.map(name), here.indexOf(state.episode), (n) => choose(here[n]));
  const picks = set.rows[state.row].picks;
  choice($("#episode .picks"), picks.length ? ["best", "median", "worst"] : [], picks.indexOf(state.episode), (n) => choose(picks[n]));
}

function drawPlan(set, row) {
  const { scene, places, poses } = stage, [width, height] = scene.size, unit = Math.max(width, height) / 100;
  const half = (d, name) => svg("path", { class: name, d, transform: "scale(.5)" });
  const thick = (n) => `stroke-width:${(n * unit).toFixed(2)}`;
  const root = svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": `${scene.name}, ${data.rows[row]}` });
  stage.seen = svg("path", { class: "seen" });
  stage.view = svg("path", { class: "view" });
  stage.path = svg("path", { class: "path way", style: thick(0.5) });
  stage.agent = svg("path", { class: "agent", style: thick(0.2), d: line([[0, -2.2], [1.4, 1.5], [0, 0.7], [-1.4, 1.5]].map(([a, b]) => [a * unit, b * unit])) + "z" });
  const whole = svg("path", { class: "whole", style: `${thick(0.2)};stroke-dasharray:${unit * 0.5} ${unit * 0.7}`, d: line(places) });
  const start = svg("circle", { class: "start", style: thick(0.4), cx: places[0][0], cy: places[0][1], r: unit });
  root.append(half(scene.free, "floor"), stage.seen, stage.view, half(scene.wall, "wall"), whole, stage.path, start, stage.agent);
  // A bar of a round length, as the only measure.
  const metres = stride(0.25 * width * scene.pixel, 1), long = metres / scene.pixel;
  const bar = `M${unit} ${height + 2 * unit}v${unit}h${long}v${-unit}`;
  const size = 2.2 * unit;
  const name = svg("text", { x: 2 * unit + long, y: height + 3.4 * unit, style: `font-size:${size}px` }, `${metres} m`);
  root.append(svg("path", { class: "scale", style: thick(0.2), d: bar }), name);
  root.setAttribute("viewBox", `0 0 ${width} ${height + 5 * unit}`);
  $("#episode .plan").replaceChildren(root);
}

function drawFacts(set, episode, bumps, metres) {
  const mean = shares(set.rows[episode[0]].curves[state.count][0], 3), { curve } = stage;
  const auc = curve.length > 1 ? curve.slice(1).reduce((sum, v, n) => sum + (v + curve[n]) / 2, 0) / (curve.length - 1) : curve[0] ?? 0;
  const facts = [
    ["Final Cov.", (at(curve, Infinity) ?? 0).toFixed(3)], ["AUC", auc.toFixed(3)],
    ["Walked", `${metres.toFixed(0)} m`], ["Bumps", bumps],
  ];
  $("#episode .facts").replaceChildren(...facts.flatMap(([name, value]) => [html("dt", {}, name), html("dd", {}, value)]));
  const top = Math.min(1, Math.ceil(10 * Math.max(0.1, ...curve, ...mean)) / 10), row = episode[0];
  const drawn = chart($("#episode .chart"), 210, [0, set.steps, "step"], [0, top, "covered, %"]);
  const path = (values) => line(values.map((v, n) => [drawn.x(n), drawn.y(v)]));
  stage.cursor = svg("path", { class: "cursor" });
  stage.dot = svg("circle", { class: "agent", r: 4 });
  const own = svg("path", { class: "path", style: "stroke-width:2", d: path(curve) });
  drawn.root.append(svg("path", { class: "whole", d: path(mean) }), own, stage.cursor, stage.dot);
  drawn.root.setAttribute("aria-label", `Coverage of this episode, dotted the mean of ${data.rows[row]}`);
  stage.chart = drawn;
}

function show(step) {
  const { poses, places, curve, chart: drawn, scene } = stage, [x, y] = places[step];
  state.step = stage.step = step;
  for (let n = stage.views.length; n <= step; n++) stage.views.push(view(n));
  stage.seen.setAttribute("d", stage.views.slice(0, step + 1).join(""));
  stage.view.setAttribute("d", stage.views[step]);
  stage.path.setAttribute("d", line(places.slice(0, step + 1)));
  stage.agent.setAttribute("transform", `translate(${x.toFixed(2)} ${y.toFixed(2)}) rotate(${-45 * poses[step][2]})`);
  const covered = at(curve, step) ?? 0;
  stage.cursor.setAttribute("d", `M${drawn.x(step).toFixed(1)} ${drawn.box[1]}V${drawn.box[3]}`);
  stage.dot.setAttribute("cx", drawn.x(step).toFixed(1));
  stage.dot.setAttribute("cy", drawn.y(covered).toFixed(1));
  $(".player input").value = step;
  $(".player output").textContent = `step ${step} · ${percent(covered)} covered`;
}

function play(last) {
  if (playing !== null) {
    stop();
    write();
    return;
  }
  if (state.step >= last) show(0);
  $(".play").textContent = "⏸";
  $(".play").setAttribute("aria-label", "Pause");
  // An episode takes a quarter of a minute, whatever its length.
  const delay = Math.max(30, Math.min(150, 15000 / last));
  playing = setInterval(() => {
    show(state.step + 1);
    if (state.step >= last) {
      stop();
      write();
    }
  }, delay);
}

// The walls of an outline in half pixels: [x, y, dx, dy] in pixels.
function segments(outline) {
  const found = [];
  for (const ring of outline.split("z")) {
    const numbers = (ring.match(/-?\d+/g) ?? []).map((n) => Number(n) / 2);
    let [x, y] = numbers;
    const [x0, y0] = numbers;
    for (let n = 2; n + 1 < numbers.length; n += 2) {
      found.push([x, y, numbers[n], numbers[n + 1]]);
      x += numbers[n];
      y += numbers[n + 1];
    }
    if (numbers.length > 2) found.push([x, y, x0 - x, y0 - y]);
  }
  return found;
}

// What level rays meet from the pose of a step, as a path. Outlines have the air to their right, so where a ray crosses one tells
// whether it comes into the air or leaves it: an agent close to a wall stands on what is drawn as wall.
function view(step) {
  const { poses, places, scene, walls } = stage, [x, y] = places[step], [angle, range] = data.view;
  const far = range / scene.pixel, close = 0.75 / scene.pixel, rays = 72, points = [[x, y]];
  const near = walls.filter(([a, b, da, db]) => Math.hypot(a + da / 2 - x, b + db / 2 - y) < far + Math.hypot(da, db) / 2);
  const inside = walls.filter(([a, b, da, db]) => (b > y) !== (b + db > y) && a + da * (y - b) / db > x).length % 2 === 1;
  for (let n = 0; n <= rays; n++) {
    const azimuth = (45 * poses[step][2] + angle * (n / rays - 0.5)) * Math.PI / 180;
    const dx = -Math.sin(azimuth), dy = -Math.cos(azimuth);
    let leaves = far, enters = inside ? 0 : far;
    for (const [a, b, da, db] of near) {
      const turn = dx * db - dy * da;
      if (turn === 0) continue;
      const t = ((a - x) * db - (b - y) * da) / turn, u = ((a - x) * dy - (b - y) * dx) / turn;
      // Rays along the lattice often meet the very end of a wall.
      if (t <= 0 || u < -1e-6 || u > 1 + 1e-6) continue;
      if (turn > 0) leaves = Math.min(leaves, t);
      else enters = Math.min(enters, t);
    }
    const reach = enters <= close ? leaves : 0;
    points.push([x + dx * reach, y + dy * reach]);
  }
  return `${line(points)}z`;
}

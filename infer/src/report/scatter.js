// Two rows against each other, a point for each scene.

function drawScatter() {
  const set = data.sets[state.set], form = $("#scatter form"), place = $("#scatter .chart");
  const choose = (key) => (n) => { state[key] = n; write(); drawScatter(); };
  options(form.x, data.rows, state.x, choose("x"));
  options(form.y, data.rows, state.y, choose("y"));
  form.by.value = state.by;
  form.by.onchange = () => { state.by = form.by.value; write(); drawScatter(); };
  const score = (row, scene) => set.rows[row].scenes[scene][state.count]?.[state.by === "auc" ? 1 : 0];
  const points = set.scenes.map(({ name }, n) => ({ name, x: score(state.x, n), y: score(state.y, n) }))
    .filter((point) => point.x !== undefined && point.y !== undefined);
  const values = points.flatMap((point) => [point.x, point.y]);
  const low = Math.max(0, Math.floor(10 * Math.min(...values, 1) - 0.2) / 10), high = Math.min(1, Math.ceil(10 * Math.max(...values, 0) + 0.2) / 10);
  const [from, to] = high > low ? [low, high] : [0, 1], measure = state.by === "auc" ? "AUC" : "Final Cov.";
  const side = Math.min(480, Math.max(260, place.clientWidth));
  const [across, up] = [data.rows[state.x], data.rows[state.y]];
  const { root, x, y } = chart(place, side, [from, to, `${across}, ${measure}`], [from, to, `${up}, ${measure}`], (v) => v.toFixed(2));
  root.setAttribute("aria-label", `${up} against ${across}, scene by scene`);
  root.append(svg("path", { class: "cursor", d: line([[x(from), y(from)], [x(to), y(to)]]) }));
  const caption = $("#scatter figcaption"), better = points.filter((point) => point.y > point.x).length;
  const summary = `${up} is better than ${across} in ${better} of ${points.length} ${points.length === 1 ? "scene" : "scenes"}: above the diagonal.`;
  caption.textContent = summary;
  for (const point of points) {
    const told = `${point.name}: ${across} ${point.x.toFixed(3)}, ${up} ${point.y.toFixed(3)}`;
    const dot = svg("circle", { class: "dot", cx: x(point.x).toFixed(1), cy: y(point.y).toFixed(1), r: 6, tabindex: 0 }, svg("title", {}, told));
    dot.onpointerenter = dot.onfocus = () => { caption.textContent = told; };
    dot.onpointerleave = dot.onblur = () => { caption.textContent = summary; };
    root.append(dot);
  }
}

function draw() {
  const set = data.sets[state.set];
  if (!set) return;
  document.body.dataset.count = data.counts[state.count];
  choice($("#sets"), data.sets.map((one) => one.name), state.set, (n) => {
    state.set = n;
    const asked = new URLSearchParams(location.hash.slice(1));
    for (const key of ["scene", "start", "seed", "step"]) asked.delete(key);
    asked.set("set", data.sets[n].name);
    history.replaceState(null, "", `#${asked}`);
    read();
    write();
    draw();
  });
  const counts = { exact: "exact coverage", released: "as released" };
  choice($("#counts"), data.counts.length > 1 ? data.counts.map((name) => counts[name]) : [], state.count, (n) => { state.count = n; write(); draw(); });
  document.querySelectorAll("#results .set").forEach((table, n) => table.classList.toggle("on", n === state.set));
  drawCurves();
  drawEpisode();
  drawScatter();
}

document.documentElement.classList.add("js");
read();
draw();
window.onhashchange = () => { read(); draw(); };
let width = window.innerWidth;
window.onresize = () => {
  // Phones resize the window's height as they scroll.
  if (window.innerWidth !== width) {
    width = window.innerWidth;
    draw();
  }
};

// Coverage over time: a line and a band for each row, and a legend in the order in which they end.

function drawCurves() {
  const set = data.sets[state.set], place = $("#curves .chart");
  const rows = set.rows.map((row) => row.curves[state.count].map((text) => shares(text, 3)));
  const shown = [...rows.keys()].filter((row) => rows[row][0].length && !state.off.has(row));
  const highest = shown.map((row) => Math.max(...rows[row][0].map((v, n) => v + rows[row][1][n])));
  const top = Math.min(1, Math.ceil(10 * Math.max(0.1, ...highest)) / 10);
  const height = Math.round(Math.min(440, Math.max(280, 0.6 * place.clientWidth)));
  const { root, x, y, box } = chart(place, height, [0, set.steps, "step"], [0, top, "covered, %"]);
  root.setAttribute("aria-label", `Coverage over steps, ${set.name}`);
  root.classList.toggle("many", shown.length > 4);
  for (const row of shown) {
    const [mean, spread] = rows[row];
    const edge = (sign) => mean.map((v, n) => [x(n), y(Math.max(0, Math.min(top, v + sign * spread[n])))]);
    const band = spread.some((v) => v > 0) ? [svg("path", { class: "band", d: `${line([...edge(1), ...edge(-1).reverse()])}z` })] : [];
    const mark = svg("path", { class: `mean ${dash(row)}`, d: line(mean.map((v, n) => [x(n), y(v)])) });
    root.append(svg("g", { class: style(row), "data-row": data.rows[row] }, ...band, mark));
  }
  const cursor = svg("path", { class: "cursor", d: "" });
  root.append(cursor);
  const legend = drawLegend(set, rows);
  root.onpointermove = (event) => {
    const { left, width } = root.getBoundingClientRect(), pixel = (event.clientX - left) * root.viewBox.baseVal.width / width;
    const step = Math.round(set.steps * (pixel - box[0]) / (box[2] - box[0]));
    if (step < 0 || step > set.steps) return;
    cursor.setAttribute("d", `M${x(step).toFixed(1)} ${box[1]}V${box[3]}`);
    legend(step);
  };
  root.onpointerleave = () => {
    cursor.setAttribute("d", "");
    legend(set.steps);
  };
}

// Returns what shows the values of a step.
function drawLegend(set, rows) {
  const place = $("#curves .legend"), end = (row) => at(rows[row][0], Infinity) ?? -1;
  const order = [...rows.keys()].sort((a, b) => end(b) - end(a));
  const change = () => { write(); drawCurves(); };
  const when = html("span"), values = [];
  const all = html("button", { type: "button" }, "all"), none = html("button", { type: "button" }, "none");
  all.onclick = () => { state.off.clear(); change(); };
  none.onclick = () => { order.forEach((row) => state.off.add(row)); change(); };
  const entry = (row) => {
    const swatch = svg("svg", { width: 32, height: 10, class: style(row) }, svg("path", { class: `mean ${dash(row)}`, d: "M1 5H31" }));
    values[row] = html("span");
    const button = html("button", { type: "button", "aria-pressed": !state.off.has(row) }, swatch, data.rows[row], values[row]);
    button.onclick = () => { state.off.delete(row) || state.off.add(row); change(); };
    const group = () => [...document.querySelectorAll("#curves g.row")].find((g) => g.dataset.row === data.rows[row]);
    const near = (is) => {
      group()?.classList.toggle("near", is);
      $("#curves svg").classList.toggle("dim", is && group() !== undefined);
    };
    button.onpointerenter = button.onfocus = () => near(true);
    button.onpointerleave = button.onblur = () => near(false);
    return button;
  };
  const head = html("div", { class: "head" }, html("span", {}, all, none), when);
  place.replaceChildren(head, ...order.map(entry));
  const show = (step) => {
    when.textContent = `after step ${step}`;
    for (const row of order) values[row].textContent = rows[row][0].length ? percent(at(rows[row][0], step)) : "–";
  };
  show(set.steps);
  return show;
}

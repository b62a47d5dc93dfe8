// Moves the arm and the cursors of all plots to one time: by the slider, by a finger or mouse on a plot, by a click on a moment.
(() => {
  const byId = id => document.getElementById(id), all = query => [...document.querySelectorAll(query)];
  const stage = byId("stage"), at = byId("at"), play = byId("play"), words = byId("words"), end = Number(at.max);
  const draw = text => text.split("|").map(one => `<path ${D.p[Number(one.slice(0, 2))]} d="${one.slice(2)}"/>`).join("");
  const last = (times, t) => { let k = 0; while (k + 1 < times.length && times[k + 1] <= t) k += 1; return k; };
  const since = D.w.map(one => one[0]), plots = all("svg[data-x]").map(svg => {
    const [from, to] = svg.dataset.x.split(" ").map(Number);
    return {svg, from, to, cursor: svg.querySelector(".cursor")};
  });
  const tip = document.body.appendChild(document.createElement("div"));
  tip.className = "tip"; tip.hidden = true;
  // Values of a plot's lines at a place: their last points before it, by the scale of its axis.
  const points = new Map(all("path.line").map(line => [line, line.getAttribute("d").split(/[ML]/).slice(1).map(point => point.split(" ").map(Number))]));
  const values = (svg, x) => {
    const [bottom, top, low, high, log] = svg.dataset.y.split(" ").map(Number);
    return [...svg.querySelectorAll(".line")].flatMap(line => {
      const before = points.get(line).filter(point => point[0] <= x + 12).at(-1), after = points.get(line).find(point => point[0] >= x - 12);
      if (!before || !after) return [];
      const value = low + (bottom - before[1]) / (bottom - top) * (high - low);
      return [[line.dataset.name, line.getAttribute("stroke"), Number((log ? 10 ** value : value).toPrecision(2))]];
    });
  };
  const readout = (event, svg, x, t) => {
    const lines = values(svg, x).map(([name, colour, value]) => {
      const line = document.createElement("span"), mark = document.createElement("i"), bold = document.createElement("b");
      mark.style.background = colour; bold.textContent = String(value).replace("-", "\u2212");
      line.append(mark, name, " ", bold);
      return line;
    });
    tip.replaceChildren(`${t.toFixed(3)} s`, ...lines);
    tip.hidden = false;
    const {width, height} = tip.getBoundingClientRect();
    tip.style.left = `${event.clientX + (event.clientX + width + 24 > innerWidth ? -width - 14 : 14)}px`;
    tip.style.top = `${Math.max(4, Math.min(event.clientY - height / 2, innerHeight - height - 4))}px`;
  };
  let now = 0, frame = -1, told = -1, playing = 0;

  const show = t => {
    now = Math.min(Math.max(t, 0), end);
    at.value = now;
    byId("time").textContent = `${now.toFixed(2)} s`;
    const k = last(D.t, now), w = last(since, now);
    if (k !== frame) { frame = k; stage.innerHTML = draw(D.g) + draw(D.f[k]); }
    if (w !== told) {
      told = w;
      const {headline, lines} = D.w[w][1], head = document.createElement("b");
      head.textContent = `${headline}.`;
      words.replaceChildren(head, ...lines.map(([colour, name, text]) => {
        const line = document.createElement("span"), bold = document.createElement("b");
        bold.style.color = colour; bold.textContent = name;
        line.append(bold, `${text}.`);
        return line;
      }));
    }
    plots.forEach(({from, to, cursor}) => cursor.setAttribute("transform", `translate(${from + (to - from) * now / (end || 1)} 0)`));
  };
  const stop = () => { cancelAnimationFrame(playing); playing = 0; play.textContent = "Play"; };
  const start = () => {
    const begun = performance.now(), from = now >= end ? 0 : now;
    const step = time => {
      show(from + (time - begun) / 1000);
      if (now < end) playing = requestAnimationFrame(step); else stop();
    };
    play.textContent = "Pause";
    playing = requestAnimationFrame(step);
  };
  play.addEventListener("click", () => playing ? stop() : start());
  at.addEventListener("input", () => { stop(); show(Number(at.value)); });
  all(".pose").forEach(pose => pose.addEventListener("click", () => { stop(); show(Number(pose.dataset.t)); }));
  plots.forEach(({svg, from, to}) => {
    const place = event => {
      const box = svg.getBoundingClientRect(), x = (event.clientX - box.left) / box.width * svg.viewBox.baseVal.width;
      return [x, (x - from) / (to - from) * end];
    };
    const point = event => { stop(); show(place(event)[1]); };
    svg.addEventListener("pointerdown", point);
    svg.addEventListener("pointermove", event => {
      const [x, t] = place(event);
      if (event.buttons) point(event);
      if (t >= 0 && t <= end) readout(event, svg, x, t); else tip.hidden = true;
    });
    svg.addEventListener("pointerleave", () => { tip.hidden = true; });
  });
  all(".stage").forEach(one => { one.hidden = false; });
  document.body.classList.add("live");
  show(Number((all(".pose")[1] || all(".pose")[0] || {dataset: {t: 0}}).dataset.t));
})();

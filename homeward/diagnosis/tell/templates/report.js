(() => {
  const time = document.getElementById("figure-time"), chosen = document.getElementById("run");
  const run = () => chosen.selectedOptions[0].dataset;
  const view = (from, to) => Plotly.relayout(time, {"xaxis.range": [from, to]});
  const move = (direction) => {
    const [from, to] = time.layout.xaxis.range, width = to - from;
    const start = Math.max(Math.min(from + direction * width, run().length - width), 0);
    view(start, start + width);
  };
  const zoom = (factor) => {
    const [from, to] = time.layout.xaxis.range, half = factor * (to - from) / 2, middle = (from + to) / 2;
    view(Math.max(middle - half, 0), Math.min(middle + half, run().length));
  };
  chosen.onchange = () => {
    Plotly.restyle(time, {visible: time.data.map((trace) => trace.meta === Number(chosen.value))});
    Plotly.relayout(time, {"yaxis.range": [Number(run().low), Number(run().high)]});
    view(Number(run().start), Number(run().end));
  };
  document.getElementById("earlier").onclick = () => move(-1);
  document.getElementById("later").onclick = () => move(1);
  document.getElementById("closer").onclick = () => zoom(0.5);
  document.getElementById("wider").onclick = () => zoom(2);
  document.getElementById("whole").onclick = () => view(0, Number(run().length));
  // A finger on the plot scrolls the page; only a mouse draws the range to zoom into.
  if (matchMedia("(pointer: coarse)").matches) Plotly.relayout(time, {dragmode: false});
})();

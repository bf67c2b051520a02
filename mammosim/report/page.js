// The page's own script: the slider through the three planes, and the 3-D view drawn by plotly.js.
"use strict";
(() => {
  const data = JSON.parse(document.getElementById("shift-data").textContent);
  const names = Object.keys(data.views);
  if (!names.length) return;
  const $ = (id) => document.getElementById(id);
  const svgNs = "http://www.w3.org/2000/svg";
  const make = (tag, attributes) => {
    const element = document.createElementNS(svgNs, tag);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    return element;
  };
  let planes = [];
  let plot = null;

  function showView() {
    const holder = $("shift-planes");
    holder.replaceChildren();
    planes = data.views[$("shift-view").value].planes.map((plane) => {
      const [left, top, width, height] = plane.box;
      const figure = document.createElement("figure");
      figure.className = "plane";
      const svg = make("svg", { viewBox: plane.box.join(" "), role: "img",
        "aria-label": `Section of the breast, seen ${plane.caption}, compressed as far as the slider is set` });
      const image = make("image", { x: left, y: top, width, height, preserveAspectRatio: "none" });
      svg.append(image);
      const marks = plane.targets.map(([number, name, kind, x, y, toX, toY, label, lead]) => {
        const [besideX, besideY, size] = label;
        const group = make("g", { class: `moved ${kind}`, "data-target": number });
        const title = make("title", {});
        title.textContent = `${number}: ${name}`;
        const way = make("path", { class: "way", d: `M${x} ${y}L${toX} ${toY}` });
        const dot = make("circle", { r: plane.dot });
        const text = make("text", { "font-size": size, "text-anchor": "middle" });
        const line = make("path", { class: "lead" });
        text.textContent = number;
        group.append(title, way, line, dot, text);
        svg.append(group);
        return (share) => {
          const atX = x + share * (toX - x), atY = y + share * (toY - y);
          dot.setAttribute("cx", atX);
          dot.setAttribute("cy", atY);
          text.setAttribute("x", atX + besideX);
          text.setAttribute("y", atY + besideY);
          if (lead.length) {
            const [fromX, fromY, endX, endY] = lead;
            line.setAttribute("d", `M${atX + fromX} ${atY + fromY}L${atX + endX} ${atY + endY}`);
          }
        };
      });
      const caption = document.createElement("figcaption");
      caption.textContent = plane.caption;
      figure.append(svg, caption);
      holder.append(figure);
      return { image, frames: plane.frames, marks };
    });
    slide();
  }

  function slide() {
    const share = Number($("shift-slider").value) / 100;
    const said = share === 0 ? "uncompressed" : share === 1 ? "compressed"
      : `${Math.round(100 * share)} % of the way`;
    $("shift-said").textContent = said;
    $("shift-slider").setAttribute("aria-valuetext", said);
    for (const { image, frames, marks } of planes) {
      image.setAttribute("href", frames[Math.round(share * data.last)]);
      for (const mark of marks) mark(share);
    }
    if (plot) drawSolid();
  }

  // Sum of two nested lists, the second times a share.
  const moved = (place, shift, share) =>
    Array.isArray(place) ? place.map((value, n) => moved(value, shift[n], share))
      : place + share * shift;

  const colours = { mass: "#d9a400", calcification: "#d9a400", clip: "#2f9fd0" };

  function traces(share) {
    const { skin, skin_shift: skinShift, targets } = data.views[$("shift-view").value].solid;
    const [x, y, z] = moved(skin, skinShift, share);
    const now = targets.map((target) => moved(target.place, target.shift, share));
    const ways = [[], [], []];
    for (const { place, shift } of targets) {
      const end = moved(place, shift, 1);
      ways.forEach((way, axis) => way.push(place[axis], end[axis], null));
    }
    const ink = getComputedStyle(document.body).color;
    return [
      { type: "surface", x, y, z, opacity: 0.35, showscale: false, hoverinfo: "skip",
        colorscale: [[0, "#c98f7a"], [1, "#c98f7a"]], contours: { x: { highlight: false },
          y: { highlight: false }, z: { highlight: false } } },
      { type: "scatter3d", mode: "lines", x: ways[0], y: ways[1], z: ways[2], hoverinfo: "skip",
        line: { width: 5, color: "#bb6a22" } },
      { type: "scatter3d", mode: "markers+text", x: now.map((p) => p[0]), y: now.map((p) => p[1]),
        z: now.map((p) => p[2]), text: targets.map((t) => t.number), textfont: { color: ink },
        hovertext: targets.map((t) => `${t.number}: ${t.name}`), hoverinfo: "text",
        marker: { size: 6, color: targets.map((t) => colours[t.kind] || "#888888") } },
    ];
  }

  // The same box for all states of a view, so that nothing jumps while the slider moves.
  function ranges() {
    const { skin, skin_shift: shift } = data.views[$("shift-view").value].solid;
    return [0, 1, 2].map((axis) => {
      const all = [...skin[axis].flat(), ...moved(skin[axis], shift[axis], 1).flat()];
      return [Math.min(...all) - 5, Math.max(...all) + 5];
    });
  }

  const faces = { front: [1.7, 0, 0], side: [0.2, 1.6, 0.2], below: [0.2, 0, -1.6] };
  let eye = [1.3, 0.8, 0.4];

  function layout() {
    const ink = getComputedStyle(document.body).color;
    const titles = ["anterior, mm", "patient's left, mm", "superior, mm"];
    const axes = ranges().map((range, n) => ({ range, title: { text: titles[n] }, color: ink,
      gridcolor: "rgba(128,128,128,0.25)" }));
    return {
      margin: { l: 0, r: 0, t: 0, b: 0 }, showlegend: false, height: 520, uirevision: "same",
      paper_bgcolor: "rgba(0,0,0,0)", font: { color: ink },
      scene: { xaxis: axes[0], yaxis: axes[1], zaxis: axes[2], aspectmode: "data",
        camera: { eye: { x: eye[0], y: eye[1], z: eye[2] } } },
    };
  }

  function drawSolid() {
    const share = Number($("shift-slider").value) / 100;
    return window.Plotly.react(plot, traces(share), layout(),
      { displayModeBar: false, responsive: true });
  }

  async function unpack() {
    const packed = Uint8Array.from(atob($("plotly-packed").textContent), (c) => c.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
    const url = URL.createObjectURL(new Blob([await new Response(stream).arrayBuffer()],
      { type: "text/javascript" }));
    await new Promise((done, failed) => {
      const script = document.createElement("script");
      script.src = url;
      script.onload = done;
      script.onerror = () => failed(new Error("the library could not be started"));
      document.head.append(script);
    });
  }

  async function showSolid() {
    const said = $("solid-said");
    said.textContent = "Unpacking …";
    $("solid-show").disabled = true;
    try {
      const canvas = document.createElement("canvas");
      if (!(canvas.getContext("webgl2") || canvas.getContext("webgl"))) {
        throw new Error("it has no WebGL");
      }
      await unpack();
      plot = $("solid-plot");
      await drawSolid();
      plot.on("plotly_relayout", () => {
        const camera = plot.layout.scene.camera;
        if (camera && camera.eye) eye = [camera.eye.x, camera.eye.y, camera.eye.z];
      });
      $("solid-controls").hidden = false;
      $("solid-show").hidden = true;
      said.textContent = "Drag to turn, or use the buttons; the slider above compresses this view too.";
    } catch (error) {
      plot = null;
      said.textContent = `This browser cannot draw in 3-D (${error.message}). `
        + "The three planes and the tables hold the same.";
    }
  }

  function turn(around, up) {
    const length = Math.hypot(...eye);
    const azimuth = Math.atan2(eye[1], eye[0]) + (around * Math.PI) / 180;
    const limit = 1.5;
    const height = Math.max(-limit, Math.min(limit,
      Math.asin(eye[2] / length) + (up * Math.PI) / 180));
    eye = [length * Math.cos(height) * Math.cos(azimuth),
      length * Math.cos(height) * Math.sin(azimuth), length * Math.sin(height)];
  }

  function press(event) {
    const { turn: turned, zoom, face } = event.target.dataset;
    if (turned) turn(...turned.split(",").map(Number));
    if (zoom) eye = eye.map((value) => value * Number(zoom));
    if (face) eye = faces[face].slice();
    if (turned || zoom || face) {
      window.Plotly.relayout(plot, { "scene.camera.eye": { x: eye[0], y: eye[1], z: eye[2] } });
    }
  }

  document.querySelector(".interactive").hidden = false;
  document.querySelector(".interactive form").addEventListener("submit", (e) => e.preventDefault());
  $("shift-view").addEventListener("change", showView);
  $("shift-slider").addEventListener("input", slide);
  if ($("solid-show")) {
    $("solid-show").addEventListener("click", showSolid);
    $("solid-controls").addEventListener("click", press);
  }
  showView();
})();

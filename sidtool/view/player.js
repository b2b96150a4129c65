(function () {
  const data = JSON.parse(document.getElementById("data").textContent);
  const $ = (id) => document.getElementById(id);

  const times = new Float64Array(bytes(data.t));
  const palette = new Uint8Array(bytes(data.palette));
  const stage = { times, palette, size: data.size, scale: data.scale,
    colours: data.colours };
  // view: by its name, until it is left by hand.
  const state = { time: times[0], playing: false, speed: data.speed, colour: "",
    view: data.view, thin: false, frame: 0, cost: 0 };

  const world = new THREE.Scene();
  world.background = new THREE.Color(0xf4f6f8);
  const camera = new THREE.PerspectiveCamera(30, 1, 1e-3 * data.size, 1e3 * data.size);
  camera.up.fromArray(data.up);
  const lamp = new THREE.DirectionalLight(0xffffff, 0.7);
  lamp.position.set(0.3, 0.5, 1);
  camera.add(lamp);
  world.add(new THREE.AmbientLight(0xffffff, 0.55), camera);
  let renderer;
  try {
    renderer = new THREE.WebGLRenderer({ canvas: $("canvas"), antialias: true,
      preserveDrawingBuffer: true });
  } catch (error) {
    $("notice").textContent = "This browser shows no WebGL: the mechanism cannot be drawn.";
    return;
  }
  const bodies = data.bodies.map((entry) => new Body(entry, stage));
  bodies.forEach((body) => world.add(body.group));
  const joints = data.joints.map((entry) => new Joint(entry,
    bodies.find((body) => body.name === entry.body), world, stage));
  const links = data.links.map((entry) => new Link(entry, bodies, world, stage));
  const corners = (act) =>
    [...bodies, ...joints, ...links].forEach((part) => part.corners(act));
  const orbit = new THREE.OrbitControls(camera, $("canvas"));
  orbit.addEventListener("start", () => { state.view = ""; });
  orbit.addEventListener("change", () => { if (!state.playing) render(); });

  // Parts of the window: around what moves, and what a legend may take at most.
  const RIM = 0.04, LEGEND = 0.3;
  function look(name) {
    state.view = name;
    const above = (1 - 2 * RIM) * Math.tan(camera.fov * Math.PI / 360);
    const right = above * camera.aspect;
    const { clientHeight: height } = $("stage"), legend = $("legend");
    const taken = legend.hidden ? 0 : (height - legend.offsetTop) / Math.max(height, 1);
    const below = above - 2 * above * Math.min(taken, LEGEND);
    const { position, target } = fitted(corners,
      new THREE.Vector3().fromArray(data.views[name]), camera.up,
      { left: right, right, below, above });
    camera.position.copy(position);
    orbit.target.copy(target);
    orbit.update();
    render();
  }
  const refit = () => { if (state.view) look(state.view); };

  function resize() {
    const { clientWidth: w, clientHeight: h } = $("stage");
    renderer.setPixelRatio(window.devicePixelRatio);
    renderer.setSize(w, h, false);
    camera.aspect = Math.max(w, 1) / Math.max(h, 1);
    camera.updateProjectionMatrix();
    refit();
    render();
  }

  // The interval that a time lies in, and where inside it.
  function interval(t) {
    let low = 0, high = times.length - 1;
    if (high === 0) return [0, 0];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (times[middle] <= t) low = middle; else high = middle;
    }
    const s = (t - times[low]) / (times[low + 1] - times[low]);
    return [low, Math.max(0, Math.min(1, s))];
  }

  function update() {
    const [i, s] = interval(state.time);
    for (const body of bodies) {
      body.place(i, s);
      body.deform();
      body.colour(state.colour);
    }
    joints.forEach((joint) => joint.move());
    links.forEach((link) => link.move());
    $("slider").value = state.time;
    $("clock").textContent = state.time.toPrecision(5) + " s";
    const share = (state.time - times[0]) / ((times[times.length - 1] - times[0]) || 1);
    for (const mark of document.querySelectorAll(".cursor")) {
      const { left, right } = mark.dataset;
      mark.style.left = 100 * (+left + share * (right - left)) + "%";
    }
    render();
  }

  function render() {
    renderer.render(world, camera);
    state.frame += 1;
  }

  function seek(t) {
    state.time = Math.max(times[0], Math.min(times[times.length - 1], t));
    update();
  }

  // Fewer triangles while it plays, where the browser does not keep up.
  function thin(wanted) {
    state.thin = wanted;
    bodies.forEach((body) => body.thin(wanted));
    const [drawn, all] = [triangles(), data.triangles];
    $("notice").textContent = drawn < all
      ? `${drawn} of ${all} triangles while it plays: this browser draws slowly` : "";
  }
  const triangles = () => bodies.reduce((sum, body) => sum + body.triangles, 0);

  let last = 0, count = 0, watched = 0;
  function step(now) {
    if (!state.playing) return;
    const passed = last ? now - last : 0;
    last = now;
    // The first picture may take long for once; two of a second tell enough.
    if (passed > 0 && count++) {
      state.cost = state.cost ? 0.9 * state.cost + 0.1 * passed : passed;
    }
    watched += passed;
    const enough = count > 8 || (count > 1 && watched > 1000);
    const slow = enough && state.cost > data.slowest;
    if (slow && !state.thin && bodies.some((body) => body.coarse)) thin(true);
    const end = times[times.length - 1];
    const next = state.time + state.speed * passed / 1000;
    seek(next > end ? times[0] : next);
    requestAnimationFrame(step);
  }
  function play(wanted) {
    if (wanted === state.playing) return;
    state.playing = wanted;
    $("play").textContent = wanted ? "Pause" : "Play";
    last = count = watched = state.cost = 0;
    if (!wanted) { thin(false); update(); } else requestAnimationFrame(step);
  }

  function option(select, value, text) {
    const entry = document.createElement("option");
    entry.value = value;
    entry.textContent = text;
    select.appendChild(entry);
  }
  data.speeds.forEach((speed) => option($("speed"), speed, speed + " x"));
  $("speed").value = data.speed;
  option($("colour"), "", "bodies");
  for (const [key, { title }] of Object.entries(data.colours)) {
    option($("colour"), key, title);
  }
  function colour(key) {
    state.colour = $("colour").value = key;
    const range = data.colours[key];
    $("legend").hidden = !range;
    if (range) {
      $("legend-title").textContent = `${range.title} [${range.unit}]`;
      $("legend-low").textContent = "0";
      $("legend-high").textContent = (range.most / range.per).toPrecision(4);
      const stops = [0, 51, 102, 153, 204, 255].map((row) =>
        `rgb(${palette.slice(3 * row, 3 * row + 3)})`);
      $("legend-bar").style.background = `linear-gradient(90deg, ${stops})`;
    }
    refit();
    update();
  }
  // The slider of the scale is logarithmic from its middle on: 0, 1, ... 10000.
  const toScale = (x) => (x < 10 ? x / 10 : Math.pow(10, (x - 10) / 22.5));
  const fromScale = (s) => (s < 1 ? 10 * s : 10 + 22.5 * Math.log10(s));
  function scale(value) {
    stage.scale = value;
    $("scale").value = fromScale(value);
    $("scale-value").textContent = "x " + +value.toPrecision(2);
    refit();
    update();
  }

  $("slider").min = times[0];
  $("slider").max = times[times.length - 1];
  $("slider").addEventListener("input", (e) => { play(false); seek(+e.target.value); });
  $("play").addEventListener("click", () => play(!state.playing));
  $("speed").addEventListener("change", (e) => { state.speed = +e.target.value; });
  $("scale").addEventListener("input", (e) => scale(toScale(+e.target.value)));
  $("colour").addEventListener("change", (e) => colour(e.target.value));
  const shown = { joints: (on) => joints.forEach((j) => { j.mesh.visible = on; }),
    frames: (on) => bodies.forEach((b) => { b.axes.visible = on; }),
    edges: (on) => bodies.forEach((b) => { b.lines.visible = on; }) };
  for (const [id, show] of Object.entries(shown)) {
    $(id).addEventListener("change", (e) => { show(e.target.checked); refit(); update(); });
  }
  for (const button of document.querySelectorAll("[data-view]")) {
    button.addEventListener("click", () => look(button.dataset.view));
  }
  for (const plot of document.querySelectorAll(".plot")) {
    plot.addEventListener("click", (e) => {
      const { left, right } = plot.querySelector(".cursor").dataset;
      const box = plot.getBoundingClientRect();
      const share = ((e.clientX - box.left) / box.width - left) / (right - left);
      play(false);
      seek(times[0] + share * (times[times.length - 1] - times[0]));
    });
  }
  document.addEventListener("keydown", (e) => {
    if (["INPUT", "SELECT", "BUTTON"].includes(e.target.tagName)) return;
    if (e.key === " ") { e.preventDefault(); play(!state.playing); }
    const step = { ArrowLeft: -1, ArrowRight: 1 }[e.key];
    if (step) { play(false); seek(times[Math.max(0, interval(state.time)[0] + step)]); }
  });
  window.addEventListener("resize", resize);

  // For scripts that look at the page.
  window.player = { seek, play, look, colour, scale, state, stage, triangles,
    sight: () => ({ view: camera.matrixWorldInverse.toArray(),
      projection: camera.projectionMatrix.toArray() }),
    links: () => Object.fromEntries(links.map((link) => [link.name, {
      kind: link.kind, ends: link.ends.map((end) => end.place().toArray()) }])),
    bodies: () => Object.fromEntries(bodies.map((body) => [body.name, {
      place: body.group.position.toArray(), q: Array.from(body.q),
      point: (row) => new THREE.Vector3().fromArray(body.positions.array, 3 * row)
        .applyQuaternion(body.group.quaternion).add(body.group.position).toArray() }])) };
  resize();
  scale(data.scale);
  colour(data.colour);
})();

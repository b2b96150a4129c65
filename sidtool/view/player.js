"use strict";
(function () {
  const data = JSON.parse(document.getElementById("data").textContent);
  const $ = (id) => document.getElementById(id);

  // Arrays come as base64 of little-endian numbers.
  function bytes(text) {
    const raw = atob(text), found = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; i++) found[i] = raw.charCodeAt(i);
    return found.buffer;
  }
  const float32 = (text) => new Float32Array(bytes(text));
  const whole = (text) => new Uint32Array(bytes(text));

  // Shape functions are stored as shares of the largest entry of each mode.
  function modes(text, sizes) {
    const shares = new Int16Array(bytes(text)), n = shares.length / (sizes.length || 1);
    return sizes.map((size, k) => Float32Array.from(
      shares.subarray(k * n, (k + 1) * n), (x) => x * size / 32767));
  }

  const times = new Float64Array(bytes(data.t));
  const palette = new Uint8Array(bytes(data.palette));
  const state = { time: times[0], playing: false, speed: data.speed, scale: data.scale,
    colour: "", thin: false, frame: 0, cost: 0 };

  class Body {
    constructor(told) {
      this.name = told.name;
      this.rest = float32(told.positions);
      this.count = this.rest.length / 3;
      this.shapes = modes(told.shapes, told.shape_sizes);
      this.stress = told.stress ? modes(told.stress, told.stress_sizes) : null;
      this.initial = told.initial_stress ? float32(told.initial_stress) : null;
      this.places = float32(told.places);
      this.turns = float32(told.turns);
      this.elastic = float32(told.elastic);
      this.q = new Float32Array(this.shapes.length);
      this.full = new THREE.BufferAttribute(whole(told.triangles), 1);
      this.coarse = told.coarse ? new THREE.BufferAttribute(whole(told.coarse), 1) : null;
      this.active = this.coarse ? Uint32Array.from(new Set(this.coarse.array)) : null;
      this.moved = new Float32Array(3 * this.count);
      this.plain = new THREE.MeshPhongMaterial({ color: told.colour, flatShading: true,
        side: THREE.DoubleSide, shininess: 20 });
      this.coloured = new THREE.MeshPhongMaterial({ vertexColors: true, shininess: 10,
        flatShading: true, side: THREE.DoubleSide });
      this.geometry = new THREE.BufferGeometry();
      this.positions = new THREE.BufferAttribute(this.rest.slice(), 3);
      this.positions.setUsage(THREE.DynamicDrawUsage);
      this.colours = new THREE.BufferAttribute(new Uint8Array(3 * this.count), 3, true);
      this.geometry.setAttribute("position", this.positions);
      this.geometry.setAttribute("color", this.colours);
      this.geometry.setIndex(this.full);
      this.mesh = new THREE.Mesh(this.geometry, this.plain);
      this.lines = new THREE.Mesh(this.geometry, new THREE.MeshBasicMaterial({
        wireframe: true, color: 0x000000, transparent: true, opacity: 0.25 }));
      this.lines.visible = false;
      this.axes = new THREE.AxesHelper(0.1 * data.size);
      this.axes.visible = false;
      this.group = new THREE.Group();
      this.group.add(this.mesh, this.lines, this.axes);
      this.mesh.frustumCulled = this.lines.frustumCulled = false;
    }
    thin(wanted) {
      this.geometry.setIndex(wanted && this.coarse ? this.coarse : this.full);
    }
    get triangles() { return this.geometry.index.count / 3; }
    place(i, s) {
      const next = Math.min(i + 1, times.length - 1);
      const from = new THREE.Vector3().fromArray(this.places, 3 * i);
      const to = new THREE.Vector3().fromArray(this.places, 3 * next);
      this.group.position.copy(from.lerp(to, s));
      const first = new THREE.Quaternion().fromArray(this.turns, 4 * i);
      const second = new THREE.Quaternion().fromArray(this.turns, 4 * next);
      this.group.quaternion.copy(first.slerp(second, s));
      const n = this.q.length;
      for (let k = 0; k < n; k++) {
        this.q[k] = (1 - s) * this.elastic[i * n + k] + s * this.elastic[next * n + k];
      }
    }
    each(act) {
      const some = this.geometry.index === this.coarse ? this.active : null;
      const n = some ? some.length : this.count;
      for (let j = 0; j < n; j++) act(some ? some[j] : j);
    }
    deform() {
      const { rest, moved, q, shapes } = this, out = this.positions.array;
      if (!q.length) return;
      const scale = state.scale;
      this.each((v) => {
        for (let a = 3 * v; a < 3 * v + 3; a++) {
          let sum = 0;
          for (let k = 0; k < q.length; k++) sum += q[k] * shapes[k][a];
          moved[a] = sum;
          out[a] = rest[a] + scale * sum;
        }
      });
      this.positions.needsUpdate = true;
    }
    colour() {
      const range = data.colours[state.colour];
      const stressed = state.colour === "stress";
      const known = range && this.q.length && (!stressed || this.stress);
      this.mesh.material = known ? this.coloured : this.plain;
      if (!known) return;
      const out = this.colours.array, { moved, stress, initial, q, count } = this;
      const s = new Float64Array(6);
      this.each((v) => {
        let value;
        if (stressed) {
          for (let c = 0; c < 6; c++) {
            let sum = initial ? initial[6 * v + c] : 0;
            for (let k = 0; k < q.length; k++) sum += q[k] * stress[k][6 * v + c];
            s[c] = sum;
          }
          value = Math.sqrt(((s[0] - s[1]) ** 2 + (s[1] - s[2]) ** 2 + (s[2] - s[0]) ** 2)
            / 2 + 3 * (s[3] ** 2 + s[4] ** 2 + s[5] ** 2));
        } else {
          value = Math.hypot(moved[3 * v], moved[3 * v + 1], moved[3 * v + 2]);
        }
        const row = 3 * Math.max(0, Math.min(255, Math.round(255 * value / range.most)));
        out[3 * v] = palette[row]; out[3 * v + 1] = palette[row + 1];
        out[3 * v + 2] = palette[row + 2];
      });
      this.colours.needsUpdate = true;
    }
  }

  class Joint {
    constructor(told) {
      this.body = bodies.find((body) => body.name === told.body);
      this.rest = new THREE.Vector3().fromArray(told.position);
      this.shapes = told.shapes;
      const form = told.kind === "revolute" || told.kind === "spherical"
        ? new THREE.SphereGeometry(0.012 * data.size, 16, 12)
        : new THREE.BoxGeometry(...Array(3).fill(0.022 * data.size));
      this.mesh = new THREE.Mesh(form, new THREE.MeshPhongMaterial({ color: 0xd55e00 }));
      this.mesh.visible = false;
      (this.body ? this.body.group : world).add(this.mesh);
    }
    move() {
      this.mesh.position.copy(this.rest);
      if (!this.body) return;
      const { q } = this.body;
      ["x", "y", "z"].forEach((axis, a) => {
        for (let k = 0; k < q.length; k++) {
          this.mesh.position[axis] += state.scale * q[k] * this.shapes[a][k];
        }
      });
    }
  }

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
  const bodies = data.bodies.map((told) => new Body(told));
  bodies.forEach((body) => world.add(body.group));
  const joints = data.joints.map((told) => new Joint(told));
  const orbit = new THREE.OrbitControls(camera, $("canvas"));
  orbit.addEventListener("change", () => { if (!state.playing) render(); });

  const DIRECTIONS = { iso: data.views.iso, front: data.views.front, top: data.views.top,
    side: data.views.side };
  function look(name) {
    const target = new THREE.Vector3().fromArray(data.centre);
    const direction = new THREE.Vector3().fromArray(DIRECTIONS[name]).normalize();
    const half = Math.tan(camera.fov * Math.PI / 360) * Math.min(1, camera.aspect);
    camera.position.copy(target).addScaledVector(direction, 0.55 * data.size / half);
    orbit.target.copy(target);
    orbit.update();
    render();
  }

  function resize() {
    const { clientWidth: w, clientHeight: h } = $("stage");
    renderer.setPixelRatio(window.devicePixelRatio);
    renderer.setSize(w, h, false);
    camera.aspect = w / Math.max(h, 1);
    camera.updateProjectionMatrix();
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
    bodies.forEach((body) => { body.place(i, s); body.deform(); body.colour(); });
    joints.forEach((joint) => joint.move());
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

  let last = 0, count = 0;
  function step(now) {
    if (!state.playing) return;
    const passed = last ? now - last : 0;
    last = now;
    if (passed > 0) {
      state.cost = state.cost ? 0.9 * state.cost + 0.1 * passed : passed;
      count += 1;
    }
    const slow = count > 8 && state.cost > data.slowest;
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
    last = count = state.cost = 0;
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
    update();
  }
  // The slider of the scale is logarithmic from its middle on: 0, 1, ... 10000.
  const toScale = (x) => (x < 10 ? x / 10 : Math.pow(10, (x - 10) / 22.5));
  const fromScale = (s) => (s < 1 ? 10 * s : 10 + 22.5 * Math.log10(s));
  function scale(value) {
    state.scale = value;
    $("scale").value = fromScale(value);
    $("scale-value").textContent = "x " + +value.toPrecision(2);
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
    $(id).addEventListener("change", (e) => { show(e.target.checked); update(); });
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
  window.player = { seek, play, look, colour, scale, state, triangles,
    bodies: () => Object.fromEntries(bodies.map((body) => [body.name, {
      place: body.group.position.toArray(), q: Array.from(body.q),
      point: (row) => new THREE.Vector3().fromArray(body.positions.array, 3 * row)
        .applyQuaternion(body.group.quaternion).add(body.group.position).toArray() }])) };
  resize();
  scale(data.scale);
  colour(data.colour);
  look(data.view);
})();

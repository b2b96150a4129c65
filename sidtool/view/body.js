// Bodies and joints: where they are, their deformation and their colours.
//
// The stage that they are made for holds: times, size of the mechanism, scale of the
// deformation, palette, and colours as { key: what it reaches to }.

"use strict";

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

// Axes of a body, and half a joint's mark, as shares of the mechanism.
const AXES = 0.1, MARK = 0.012;

// The least and the largest x, y and z of points that follow each other.
class Box {
  constructor(points) {
    this.low = [Infinity, Infinity, Infinity];
    this.high = [-Infinity, -Infinity, -Infinity];
    for (let i = 0; i < points.length; i++) this.reach(i % 3, points[i], 0);
  }
  reach(axis, value, around) {
    this.low[axis] = Math.min(this.low[axis], value - around);
    this.high[axis] = Math.max(this.high[axis], value + around);
  }
}

class Body {
  constructor(data, stage) {
    this.name = data.name;
    this.stage = stage;
    this.rest = float32(data.positions);
    this.count = this.rest.length / 3;
    this.shapes = modes(data.shapes, data.shape_sizes);
    this.stress = data.stress ? modes(data.stress, data.stress_sizes) : null;
    this.initial = data.initial_stress ? float32(data.initial_stress) : null;
    this.places = float32(data.places);
    this.turns = float32(data.turns);
    this.elastic = float32(data.elastic);
    this.box = new Box(this.rest);
    this.reaches = this.shapes.map((shape) => new Box(shape));
    this.q = new Float32Array(this.shapes.length);
    this.full = new THREE.BufferAttribute(whole(data.triangles), 1);
    this.coarse = data.coarse ? new THREE.BufferAttribute(whole(data.coarse), 1) : null;
    this.active = this.coarse ? Uint32Array.from(new Set(this.coarse.array)) : null;
    this.moved = new Float32Array(3 * this.count);
    this.plain = new THREE.MeshPhongMaterial({ color: data.colour, flatShading: true,
      side: THREE.DoubleSide, shininess: 20, transparent: data.sketched,
      opacity: data.sketched ? 0.6 : 1 });
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
    this.axes = new THREE.AxesHelper(AXES * stage.size);
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
    const next = Math.min(i + 1, this.stage.times.length - 1);
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
  // Calls `act` with the corners of a box that holds the body, and with the ends of its
  // axes where they are shown, for all times.
  corners(act) {
    if (!this.count) return;
    const point = new THREE.Vector3(), place = new THREE.Vector3();
    const turn = new THREE.Quaternion(), { scale, times } = this.stage;
    const n = this.q.length, low = [0, 0, 0], high = [0, 0, 0];
    for (let i = 0; i < times.length; i++) {
      place.fromArray(this.places, 3 * i);
      turn.fromArray(this.turns, 4 * i);
      for (let a = 0; a < 3; a++) {
        low[a] = this.box.low[a];
        high[a] = this.box.high[a];
        for (let k = 0; k < n; k++) {
          const q = scale * this.elastic[i * n + k], reach = this.reaches[k];
          low[a] += q * (q > 0 ? reach.low[a] : reach.high[a]);
          high[a] += q * (q > 0 ? reach.high[a] : reach.low[a]);
        }
      }
      for (let c = 0; c < 8; c++) {
        point.set((c & 1 ? high : low)[0], (c & 2 ? high : low)[1],
          (c & 4 ? high : low)[2]);
        act(point.applyQuaternion(turn).add(place));
      }
      for (let a = 0; this.axes.visible && a < 3; a++) {
        act(point.set(0, 0, 0).setComponent(a, AXES * this.stage.size)
          .applyQuaternion(turn).add(place));
      }
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
    const scale = this.stage.scale;
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
  colour(key) {
    const range = this.stage.colours[key], palette = this.stage.palette;
    const stressed = key === "stress";
    const known = range && this.q.length && (!stressed || this.stress);
    this.mesh.material = known ? this.coloured : this.plain;
    if (!known) return;
    const out = this.colours.array, { moved, stress, initial, q } = this;
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
  constructor(data, body, world, stage) {
    this.body = body;
    this.stage = stage;
    this.rest = new THREE.Vector3().fromArray(data.position);
    this.shapes = data.shapes;
    const form = data.kind === "revolute" || data.kind === "spherical"
      ? new THREE.SphereGeometry(MARK * stage.size, 16, 12)
      : new THREE.BoxGeometry(...Array(3).fill(1.8 * MARK * stage.size));
    this.mesh = new THREE.Mesh(form, new THREE.MeshPhongMaterial({ color: 0xd55e00 }));
    this.mesh.visible = false;
    (body ? body.group : world).add(this.mesh);
    if (!body) return;
    data.position.forEach((x, a) => {
      body.box.reach(a, x, MARK * stage.size);
      body.reaches.forEach((reach, k) => reach.reach(a, data.shapes[a][k], 0));
    });
  }
  // As a body does; one that stands on the ground is at one place.
  corners(act) {
    if (this.body) return;
    for (const s of [-MARK, MARK]) act(this.rest.clone().addScalar(s * this.stage.size));
  }
  move() {
    this.mesh.position.copy(this.rest);
    if (!this.body) return;
    const { q } = this.body;
    ["x", "y", "z"].forEach((axis, a) => {
      for (let k = 0; k < q.length; k++) {
        this.mesh.position[axis] += this.stage.scale * q[k] * this.shapes[a][k];
      }
    });
  }
}

// A point of a body, or of the ground, that moves with the deformation.
class Anchor {
  constructor(data, bodies, stage) {
    this.body = bodies.find((body) => body.name === data.body);
    this.stage = stage;
    this.rest = new THREE.Vector3().fromArray(data.position);
    this.shapes = data.shapes;
    if (!this.body) return;
    data.position.forEach((x, a) => {
      this.body.box.reach(a, x, 0);
      this.body.reaches.forEach((reach, k) => reach.reach(a, data.shapes[a][k], 0));
    });
  }
  place() {
    const point = this.rest.clone();
    if (!this.body) return point;
    const { q, group } = this.body;
    ["x", "y", "z"].forEach((axis, a) => {
      for (let k = 0; k < q.length; k++) {
        point[axis] += this.stage.scale * q[k] * this.shapes[a][k];
      }
    });
    return point.applyQuaternion(group.quaternion).add(group.position);
  }
}

// A spring, damper, actuator or rod: a mesh along x from 0 to 1, stretched to its ends.
class Link {
  constructor(data, bodies, world, stage) {
    this.name = data.name;
    this.kind = data.kind;
    this.ends = data.ends.map((end) => new Anchor(end, bodies, stage));
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position",
      new THREE.BufferAttribute(float32(data.positions), 3));
    geometry.setIndex(new THREE.BufferAttribute(whole(data.triangles), 1));
    this.mesh = new THREE.Mesh(geometry, new THREE.MeshPhongMaterial({
      color: data.colour, flatShading: true, side: THREE.DoubleSide }));
    this.mesh.frustumCulled = false;
    world.add(this.mesh);
  }
  // Ends on bodies are in the boxes of these.
  corners(act) {
    this.ends.forEach((end) => { if (!end.body) act(end.rest.clone()); });
  }
  move() {
    const [from, to] = this.ends.map((end) => end.place());
    const way = to.sub(from), length = way.length();
    this.mesh.position.copy(from);
    this.mesh.scale.set(Math.max(length, 1e-9), 1, 1);
    if (length > 0) {
      this.mesh.quaternion.setFromUnitVectors(new THREE.Vector3(1, 0, 0),
        way.divideScalar(length));
    }
  }
}

// Where a camera stands that looks in a given direction and sees all that moves.

// The nearest eye { position, target } from which all points are in the window.
//
// corners(act) calls act with every point; back, from the mechanism to the eye, and up
// are vectors; the window ends where a point that is one unit deep is `left`, `right`,
// `below` or `above` units off the line of sight. A point p is not right of it if
// p.x + right p.z <= eye.x + right eye.z in the axes of the camera, and so on: the
// largest sums of all points bound the eye.
function fitted(corners, back, up, { left, right, below, above }) {
  const z = back.clone().normalize();
  const x = new THREE.Vector3().crossVectors(up, z).normalize();
  const y = new THREE.Vector3().crossVectors(z, x);
  const most = { left: -Infinity, right: -Infinity, below: -Infinity, above: -Infinity };
  let near = -Infinity, far = Infinity;
  corners((point) => {
    const px = point.dot(x), py = point.dot(y), pz = point.dot(z);
    most.left = Math.max(most.left, left * pz - px);
    most.right = Math.max(most.right, right * pz + px);
    most.below = Math.max(most.below, below * pz - py);
    most.above = Math.max(most.above, above * pz + py);
    near = Math.max(near, pz);
    far = Math.min(far, pz);
  });
  const depth = Math.max((most.left + most.right) / (left + right),
    (most.below + most.above) / (below + above));
  // In the middle of what is free in the direction that has room to spare.
  const ex = (most.right - most.left - (right - left) * depth) / 2;
  const ey = (most.above - most.below - (above - below) * depth) / 2;
  const position = z.clone().multiplyScalar(depth).addScaledVector(x, ex)
    .addScaledVector(y, ey);
  const target = position.clone().addScaledVector(z, (near + far) / 2 - depth);
  return { position, target };
}

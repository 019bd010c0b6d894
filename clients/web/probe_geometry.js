// Coordinates of a probe: on the lat-long image and the cube cross of the sky, and on the displayed image. Pure functions;
// directions are [x, y, z], with the conventions of docs/internals/how-it-works.md.

// u to the right, v downwards, both 0 to 1; the middle is +Z, a quarter to its left +X, the top row +Y.
export function toLatLong([x, y, z]) {
  const u = 0.5 - Math.atan2(x, z) / (2 * Math.PI);
  return { u: u - Math.floor(u), v: Math.acos(Math.min(1, Math.max(-1, y / Math.hypot(x, y, z)))) / Math.PI };
}

export function fromLatLong(u, v) {
  const phi = Math.PI - 2 * Math.PI * u;
  const theta = Math.PI * v;
  return [Math.sin(theta) * Math.sin(phi), Math.cos(theta), Math.sin(theta) * Math.cos(phi)];
}

// A cross of four by three faces, seen from inside the cube looking at +Z: `at` is the face's position, `right` and `up` its axes.
// Neighbours in the middle row and above and below +Z fit together.
export const FACES = [
  { name: '+X', axis: [1, 0, 0], right: [0, 0, 1], up: [0, 1, 0], at: [0, 1] },
  { name: '-X', axis: [-1, 0, 0], right: [0, 0, -1], up: [0, 1, 0], at: [2, 1] },
  { name: '+Y', axis: [0, 1, 0], right: [-1, 0, 0], up: [0, 0, -1], at: [1, 0] },
  { name: '-Y', axis: [0, -1, 0], right: [-1, 0, 0], up: [0, 0, 1], at: [1, 2] },
  { name: '+Z', axis: [0, 0, 1], right: [-1, 0, 0], up: [0, 1, 0], at: [1, 1] },
  { name: '-Z', axis: [0, 0, -1], right: [1, 0, 0], up: [0, 1, 0], at: [3, 1] },
];

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

export function faceOf(w) {
  return FACES.reduce((best, face) => (dot(face.axis, w) > dot(best.axis, w) ? face : best));
}

// In units of faces from the cross's top left: x 0 to 4, y 0 to 3.
export function toCross(w) {
  const face = faceOf(w);
  const scale = 1 / dot(face.axis, w);
  return {
    x: face.at[0] + (dot(face.right, w) * scale + 1) / 2,
    y: face.at[1] + (1 - dot(face.up, w) * scale) / 2,
  };
}

// null in the empty corners of the cross.
export function fromCross(x, y) {
  const face = FACES.find(({ at }) => Math.floor(x) === at[0] && Math.floor(y) === at[1]);
  if (!face) return null;
  const a = 2 * (x - face.at[0]) - 1;
  const b = 1 - 2 * (y - face.at[1]);
  const w = face.axis.map((c, i) => c + a * face.right[i] + b * face.up[i]);
  const scale = 1 / Math.hypot(...w);
  return w.map((c) => c * scale);
}

// The fate of a sample of `probed` (PROTOCOL.md 4.16.7).
const KINDS = ['chosen', 'blocked', 'effective'];
export function readSample(s) {
  const kind = s.length > 3 ? KINDS[s[3]] : 'generated';
  return { w: s.slice(0, 3), kind, beta: s[4] ?? 0, mis: s[5] ?? 0, rgb: s.length > 6 ? s.slice(6, 9) : [0, 0, 0] };
}

export const luminance = ([r, g, b]) => 0.2126 * r + 0.7152 * g + 0.0722 * b;

// The visibility map's letter for a direction.
export function sightAt(visibility, w) {
  const { u, v } = toLatLong(w);
  const row = visibility[Math.min(visibility.length - 1, Math.floor(v * visibility.length))];
  return row[Math.min(row.length - 1, Math.floor(u * row.length))];
}

// Fits an image of width x height pixels into `box` {left, top, width, height}, centred.
export function fit(box, width, height) {
  const scale = Math.min(box.width / width, box.height / height);
  return {
    scale,
    left: box.left + (box.width - scale * width) / 2,
    top: box.top + (box.height - scale * height) / 2,
  };
}

// The pixel at a window position; null outside the image.
export function pixelAt(box, width, height, clientX, clientY) {
  const { scale, left, top } = fit(box, width, height);
  const x = Math.floor((clientX - left) / scale);
  const y = Math.floor((clientY - top) / scale);
  return x >= 0 && y >= 0 && x < width && y < height ? { x, y } : null;
}

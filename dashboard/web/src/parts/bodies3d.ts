// SPDX-License-Identifier: Apache-2.0
// The bodies of a replayed attempt in space: each is one mesh of its collision pieces, where it was at each step; and
// the nearest pair, a segment between its points.
import {
  BoxGeometry, BufferGeometry, CylinderGeometry, Float32BufferAttribute, Group, Line, LineBasicMaterial, Matrix4, Mesh, MeshLambertMaterial, Quaternion, SphereGeometry, Vector3,
} from 'three';
import { ConvexGeometry } from 'three/examples/jsm/geometries/ConvexGeometry.js';
import type { Color } from 'three';
import type { ReplayGeometry } from '../core/types';
import { nearestAt, nearestText, type ReplayFiles } from './replay';

type Piece = ReplayGeometry['geometry'][number];

export interface Bodies {
  group: Group;
  /** How many bodies are drawn, and of how many pieces. */
  drawn: { bodies: number; pieces: number };
  seek: (step: number) => void;
  /** Where the value of the nearest pair stands, and what it says; null: none now. */
  nearest: { at: Vector3; text: string } | null;
}

/** `token`: the colour of a body by its name; `paint`: the colour of a token. */
export function makeBodies(files: ReplayFiles, token: (body: string) => string, paint: (token: string) => Color): Bodies {
  const { bodies, geometry } = files.geometry;
  const group = new Group();
  const meshes = new Map<string, Mesh>();
  for (const name of new Set(geometry.map((piece) => piece.body))) {
    const moving = bodies.includes(name);
    // what stands still lies under the grid
    const material = new MeshLambertMaterial({ color: paint(moving ? token(name) : 'hover'), flatShading: true, polygonOffset: !moving, polygonOffsetFactor: 2 });
    const mesh = new Mesh(merged(geometry.filter((piece) => piece.body === name)), material);
    group.add(mesh);
    if (moving) meshes.set(name, mesh);
  }
  const segment = new Line(new BufferGeometry().setAttribute('position', new Float32BufferAttribute(new Float32Array(6), 3)), new LineBasicMaterial({ color: paint('warn'), depthTest: false }));
  segment.renderOrder = 1;
  segment.frustumCulled = false;
  group.add(segment);
  const steps = files.poses.length / (7 * bodies.length);
  const result: Bodies = {
    group,
    drawn: { bodies: meshes.size, pieces: geometry.length },
    nearest: null,
    seek(step) {
      const row = 7 * bodies.length * Math.max(0, Math.min(steps - 1, step));
      bodies.forEach((name, i) => {
        const mesh = meshes.get(name);
        if (!mesh) return;
        mesh.position.fromArray(files.poses, row + 7 * i);
        place(mesh.quaternion, files.poses.subarray(row + 7 * i + 3, row + 7 * i + 7));
      });
      const near = nearestAt(files.plan, step);
      segment.visible = near?.a_m !== undefined && near.b_m !== undefined;
      result.nearest = null;
      if (!near?.a_m || !near.b_m) return;
      const [a, b] = [new Vector3().fromArray(near.a_m), new Vector3().fromArray(near.b_m)];
      const ends = segment.geometry.getAttribute('position');
      ends.setXYZ(0, a.x, a.y, a.z);
      ends.setXYZ(1, b.x, b.y, b.z);
      ends.needsUpdate = true;
      result.nearest = { at: a.add(b).multiplyScalar(0.5), text: nearestText(near) };
    },
  };
  return result;
}

/** Files say w first, three says it last. */
function place(quaternion: Quaternion, wxyz: ArrayLike<number>): Quaternion {
  return quaternion.set(wxyz[1]!, wxyz[2]!, wxyz[3]!, wxyz[0]!);
}

/** One geometry of all pieces, in the body's frame: a call a body instead of one a piece. */
function merged(pieces: Piece[]): BufferGeometry {
  const all: number[] = [];
  for (const piece of pieces) {
    const whole = shapeOf(piece);
    const shape = whole.index ? whole.toNonIndexed() : whole;
    shape.applyMatrix4(new Matrix4().compose(new Vector3().fromArray(piece.pose), place(new Quaternion(), piece.pose.slice(3)), new Vector3(1, 1, 1)));
    for (const value of shape.getAttribute('position').array) all.push(value);
    shape.dispose();
    whole.dispose();
  }
  // faces need no normals of their own: the shading is flat
  return new BufferGeometry().setAttribute('position', new Float32BufferAttribute(all, 3));
}

function shapeOf(piece: Piece): BufferGeometry {
  const [x = 0, y = 0, z = 0] = piece.size;
  switch (piece.shape) {
    case 'box': return new BoxGeometry(2 * x, 2 * y, 2 * z);
    case 'sphere': return new SphereGeometry(x, 16, 12);
    // three's own stand along y
    case 'cylinder': return new CylinderGeometry(x, x, 2 * y, 20).rotateX(Math.PI / 2);
    case 'capsule': return capsule(x, y);
    case 'convex': return new ConvexGeometry((piece.vertices ?? []).map((one) => new Vector3().fromArray(one)));
  }
}

/** A sphere whose halves are pulled apart along z; an odd number of rings leaves none between them. */
function capsule(radius: number, half: number): BufferGeometry {
  const sphere = new SphereGeometry(radius, 16, 13).rotateX(Math.PI / 2);
  const points = sphere.getAttribute('position');
  for (let i = 0; i < points.count; i++) points.setZ(i, points.getZ(i) + Math.sign(points.getZ(i)) * half);
  return sphere;
}

// SPDX-License-Identifier: Apache-2.0
// The scene in space: table, tool path by stage and as commanded, objects at their places, the camera that recorded.
// Loaded when it is first needed; draws on demand only.
import {
  BufferGeometry, CatmullRomCurve3, Color, Float32BufferAttribute, HemisphereLight, Line, LineBasicMaterial, LineDashedMaterial, LineSegments, Mesh,
  MeshLambertMaterial, PerspectiveCamera, Quaternion, Scene, SphereGeometry, TubeGeometry, Vector3, WebGLRenderer, DirectionalLight,
} from 'three';
import { OrbitControls } from 'three/examples/jsm/controls/OrbitControls.js';
import { color } from '../core/theme';
import { makeBodies } from './bodies3d';
import type { SpaceData, SpaceView } from './space';

const reach = { low: 0.4, high: 4 };

export function mount(host: HTMLElement, labels: HTMLElement, data: SpaceData): SpaceView {
  const renderer = new WebGLRenderer({ antialias: true, alpha: true });
  renderer.setPixelRatio(Math.min(2, devicePixelRatio));
  host.prepend(renderer.domElement);
  const scene = new Scene();
  scene.add(new HemisphereLight(0xffffff, 0x888888, 2.2));
  const sun = new DirectionalLight(0xffffff, 1.4);
  sun.position.set(-0.5, 0.5, 3);
  scene.add(sun);

  scene.add(grid());
  for (const path of data.paths) scene.add(path.dashed || path.points.length < 9 ? lineOf(path.points, path.token, path.dashed) : tube(path.points, path.token));

  const shapes = data.replay ? makeBodies(data.replay.files, data.replay.token, paint) : null;
  const distance = document.createElement('span');
  if (shapes) {
    scene.add(shapes.group);
    labels.append(distance);
    host.dataset['bodies'] = String(shapes.drawn.bodies);
    host.dataset['pieces'] = String(shapes.drawn.pieces);
  }

  const tool = ball(shapes ? 0.006 : 0.012, 'hand');
  scene.add(tool);
  const bodies = data.objects.map((object) => {
    const body = ball(object.token === 'muted' ? 0.014 : 0.02, object.token);
    scene.add(body);
    const stem = lineOf(new Float32Array([0, 0, 0, 0, 0, -1]), object.token, false);
    scene.add(stem);
    body.visible = stem.visible = !shapes;
    const label = document.createElement('span');
    label.textContent = object.name;
    labels.append(label);
    return { object, body, stem, label };
  });

  const camera = new PerspectiveCamera(45, 1, 0.02, 20);
  camera.up.set(0, 0, 1);
  const controls = new OrbitControls(camera, renderer.domElement);
  controls.minDistance = reach.low;
  controls.maxDistance = reach.high;
  controls.minPolarAngle = (5 * Math.PI) / 180;
  controls.maxPolarAngle = (85 * Math.PI) / 180;

  const recorded = data.camera ? frustum(data.camera) : null;
  if (recorded) scene.add(recorded);
  const view = (name: 'camera' | 'top' | 'side') => {
    controls.target.set(0, 0.3, 0.05);
    camera.fov = 45;
    if (name === 'camera' && data.camera) {
      const [x, y, z] = data.camera.position as [number, number, number];
      camera.position.set(x, y, z);
      // from where it was recorded, but nearer: what is in front of the arm fills the view
      camera.fov = (data.camera.fovy_rad * 180) / Math.PI / 1.8;
      const toward = new Vector3(0, 0, -1).applyQuaternion(quaternion(data.camera.quaternion_wxyz));
      // the point on the table that the camera looks at, so that one turns about what one sees
      const distance = toward.z < -0.05 ? Math.min(3, z / -toward.z) : 1.5;
      controls.target.copy(camera.position).addScaledVector(toward, distance * 0.9);
    } else if (name === 'top') {
      camera.position.set(0, 0.42, 1.5);
    } else {
      camera.position.set(-1.3, 0.3, 0.35);
    }
    camera.updateProjectionMatrix();
    controls.update();
    draw();
  };

  let queued = 0;
  const draw = () => {
    queued ||= requestAnimationFrame(() => {
      queued = 0;
      // seen from within, the recording camera would be a cross over the picture
      if (recorded) recorded.visible = camera.position.distanceTo(new Vector3().fromArray(data.camera!.position)) > 0.1;
      renderer.render(scene, camera);
      for (const { body, label } of bodies) put(label, body.position);
      if (!shapes?.nearest) distance.style.display = 'none';
      else put(distance, shapes.nearest.at);
    });
  };
  /** A label above a place, while that is in view. */
  const put = (label: HTMLElement, place: Vector3) => {
    const at = place.clone().project(camera);
    label.style.display = at.z < 1 && Math.abs(at.x) < 1 && Math.abs(at.y) < 1 ? '' : 'none';
    label.style.transform = `translate(${((at.x + 1) / 2) * host.clientWidth}px, ${((1 - at.y) / 2) * host.clientHeight}px) translate(-50%, -22px)`;
  };
  const resize = new ResizeObserver(() => {
    if (!host.clientWidth) return;
    renderer.setSize(host.clientWidth, host.clientHeight, false);
    camera.aspect = host.clientWidth / host.clientHeight;
    camera.updateProjectionMatrix();
    draw();
  });
  resize.observe(host);
  controls.addEventListener('change', draw);
  view('camera');

  return {
    seek(step) {
      tool.position.fromArray(data.tool, 3 * step);
      shapes?.seek(step);
      distance.textContent = shapes?.nearest?.text ?? '';
      for (const { object, body, stem } of bodies) {
        body.position.fromArray(object.pose, 7 * step);
        stem.position.copy(body.position);
        stem.scale.z = Math.max(0.001, body.position.z);
      }
      draw();
    },
    view,
    dispose() {
      resize.disconnect();
      controls.dispose();
      cancelAnimationFrame(queued);
      scene.traverse((one) => {
        if (one instanceof Mesh || one instanceof Line) {
          one.geometry.dispose();
          (one.material as LineBasicMaterial).dispose();
        }
      });
      renderer.dispose();
      renderer.forceContextLoss();
      renderer.domElement.remove();
      labels.replaceChildren();
      delete host.dataset['bodies'];
      delete host.dataset['pieces'];
    },
  };
}

function paint(token: string): Color {
  return new Color(color(token));
}

function lineOf(points: Float32Array, token: string, dashed: boolean): Line {
  const geometry = new BufferGeometry();
  geometry.setAttribute('position', new Float32BufferAttribute(points, 3));
  const material = dashed ? new LineDashedMaterial({ color: paint(token), dashSize: 0.01, gapSize: 0.008 }) : new LineBasicMaterial({ color: paint(token) });
  const line = new Line(geometry, material);
  if (dashed) line.computeLineDistances();
  return line;
}

/** A path of visible width: lines are one pixel wide in WebGL. */
function tube(points: Float32Array, token: string): Mesh {
  const n = points.length / 3;
  const every = Math.max(1, Math.ceil(n / 120));
  const places: Vector3[] = [];
  for (let i = 0; i < n; i += every) places.push(new Vector3().fromArray(points, 3 * i));
  places.push(new Vector3().fromArray(points, 3 * (n - 1)));
  return new Mesh(new TubeGeometry(new CatmullRomCurve3(places), places.length * 2, 0.0035, 6), new MeshLambertMaterial({ color: paint(token) }));
}

function ball(radius: number, token: string): Mesh {
  return new Mesh(new SphereGeometry(radius, 20, 14), new MeshLambertMaterial({ color: paint(token) }));
}

function quaternion(wxyz: readonly number[]): Quaternion {
  // files say w first, three says it last
  return new Quaternion(wxyz[1], wxyz[2], wxyz[3], wxyz[0]);
}

/** Lines between each two of the points. */
function segments(points: number[], token: string): LineSegments {
  return new LineSegments(new BufferGeometry().setAttribute('position', new Float32BufferAttribute(points, 3)), new LineBasicMaterial({ color: paint(token) }));
}

/** 1.5 m of the table, a line every 10 cm. */
function grid(): LineSegments {
  return segments(Array.from({ length: 16 }, (_one, i) => i / 10 - 0.75).flatMap((at) => [at, -0.75, 0, at, 0.75, 0, -0.75, at, 0, 0.75, at, 0]), 'line');
}

/** What the recording camera saw, 15 cm of it. */
function frustum(camera: NonNullable<SpaceData['camera']>): LineSegments {
  const depth = 0.15;
  const half = depth * Math.tan(camera.fovy_rad / 2);
  const corners = [[-half, -half], [half, -half], [half, half], [-half, half]] as const;
  const points = corners.flatMap(([x, y], i) => {
    const [u, v] = corners[(i + 1) % 4]!;
    return [0, 0, 0, x, y, -depth, x, y, -depth, u, v, -depth];
  });
  const lines = segments(points, 'muted');
  lines.position.fromArray(camera.position);
  lines.quaternion.copy(quaternion(camera.quaternion_wxyz));
  return lines;
}

// SPDX-License-Identifier: Apache-2.0
// Runs the pods of deploy/kubernetes with podman: the image, commands, users, volumes and closed root file systems that the
// manifests say, on a network of their own whose DNS answers for the service of the hubs as the cluster's would. A campaign
// whose collector goes away in the middle and comes back with another address is completed, trained on and served.
//   npm ci && npm run pods -- IMAGE       needs root, and podman with netavark and aardvark-dns
// PODMAN_FLAGS: more arguments for each `podman run`, say --cgroups=disabled
import assert from "node:assert/strict";
import {spawnSync} from "node:child_process";
import {chmodSync, chownSync, existsSync, mkdirSync, mkdtempSync, readdirSync, rmSync, writeFileSync} from "node:fs";
import {tmpdir} from "node:os";
import {join} from "node:path";
import {setTimeout as after} from "node:timers/promises";
import {find, workloads} from "./manifests.mjs";

const image = process.argv[2];
if (!image) {
  console.error("usage: npm run pods -- IMAGE");
  process.exit(2);
}
const extra = (process.env.PODMAN_FLAGS ?? "").split(/\s+/).filter(Boolean);
// what is smaller here than in the manifests: [a pod's words, what stands there instead]
const episodes = 24;
const smaller = {
  "etude-collector": (words) => [...words, "--episodes", `${episodes}`],
  "etude-worker": (words) => words.map((word, i) => (words[i - 1] === "--slots" ? "2" : word)),
  "etude-trainer": (words) => words.map((word) => word.replace("--minutes 12", "--minutes 1")),
};
const token = "a token of thirty-two characters";

let interrupted = false;  // what was started is removed all the same
for (const signal of ["SIGINT", "SIGTERM"]) process.on(signal, () => (interrupted = true));

const place = mkdtempSync(join(tmpdir(), `etude-test-${process.pid}-`));
const network = `etude-test-${process.pid}`;
const started = new Set();

function podman(...words) {
  const {status, stdout, stderr, error} = spawnSync("podman", words, {encoding: "utf8", maxBuffer: 1 << 28});
  if (error) throw error;
  return {status, stdout, stderr, text: stdout + stderr};
}
function done(...words) {
  const answer = podman(...words);
  assert.equal(answer.status, 0, `podman ${words.join(" ")}\n${answer.text}`);
  return answer.stdout.trim();
}

// a folder that pods of group `owner` may write to, as fsGroup makes of volumes
function volumeFolder(name, owner) {
  const path = join(place, name);
  if (!existsSync(path)) {
    mkdirSync(path, {recursive: true});
    chownSync(path, 0, owner);
    chmodSync(path, 0o2775);
  }
  return path;
}
// written once: a shell reads its script as it goes on
function filesFolder(name, texts, mode) {
  const path = join(place, name);
  if (existsSync(path)) return path;
  mkdirSync(path);
  for (const [file, text] of Object.entries(texts)) {
    writeFileSync(join(path, file), text);
    chownSync(join(path, file), 0, 10001);
    chmodSync(join(path, file), mode);
  }
  return path;
}
function mountSource(volume, pod, owner) {
  if (volume.configMap) return filesFolder(volume.configMap.name, find("ConfigMap", volume.configMap.name).data, 0o644);
  if (volume.secret) return filesFolder(volume.secret.secretName, {token}, volume.secret.defaultMode);
  if (volume.persistentVolumeClaim) return volumeFolder(volume.persistentVolumeClaim.claimName, owner);
  assert.ok(volume.emptyDir, `${pod}: ${JSON.stringify(volume)}`);
  return volumeFolder(`${pod}-${volume.name}`, owner);
}

const hubService = find("Service", "etude-hubs");
const isHub = ({metadata}) => Object.entries(hubService.spec.selector).every(([key, value]) => metadata.labels[key] === value);

// The arguments of `podman run` that stand for a pod of `template`, named `pod`, at `address`.
function podArguments(template, pod, address, words) {
  const {securityContext, containers, volumes} = template.spec;
  assert.equal(containers.length, 1);
  const [{env, volumeMounts, securityContext: closed}] = containers;
  const value = ({value: text, valueFrom}) => {
    if (!valueFrom) return text;
    assert.equal(valueFrom.fieldRef.fieldPath, "status.podIP");
    return address;
  };
  assert.ok(closed.readOnlyRootFilesystem && !closed.allowPrivilegeEscalation && closed.capabilities.drop.includes("ALL"));
  return [
    ...extra, "--network", network, "--ip", address, "--name", `${network}-${pod}`, "--hostname", pod,
    ...(isHub(template) ? ["--network-alias", hubService.metadata.name] : []),
    "--user", `${securityContext.runAsUser}:${securityContext.fsGroup}`,
    // --read-only-tmpfs would put folders there of which a cluster knows nothing
    "--read-only", "--read-only-tmpfs=false", "--cap-drop", "ALL", "--security-opt", "no-new-privileges",
    ...env.flatMap((variable) => ["--env", `${variable.name}=${value(variable)}`]),
    ...volumeMounts.flatMap(({name, mountPath, readOnly}) => [
      "--volume",
      `${mountSource(volumes.find((v) => v.name === name), pod, securityContext.fsGroup)}:${mountPath}${readOnly ? ":ro" : ""}`]),
    image, ...words];
}
function start(name, address) {
  const {template} = workloads.find((r) => r.metadata.name === name).spec;
  const {command} = template.spec.containers[0];
  done("run", "--detach", ...podArguments(template, name, address, smaller[name]?.(command) ?? command));
  started.add(name);
}
// A program in a pod like a worker's, which is no hub, with the data: its output.
function run(address, ...words) {
  const {template} = structuredClone(workloads.find((r) => r.metadata.name === "etude-worker").spec);
  const claim = {name: "data", persistentVolumeClaim: {claimName: "etude-data"}};
  template.spec.volumes.push(claim);
  template.spec.containers[0].volumeMounts.push({name: "data", mountPath: "/data"});
  return done("run", "--rm", "--timeout", "120", ...podArguments(template, "etude-check", address, ["/bin/sh", "/etc/etude/bus/start", ...words]));
}
const container = (name) => `${network}-${name}`;
const logs = (name) => podman("logs", container(name)).text;
const state = (name) => done("inspect", "--format", "{{.State.Status}} {{.State.ExitCode}}", container(name));
function remove(name, signal) {
  done("kill", "--signal", signal, container(name));
  done("rm", "--force", container(name));
  started.delete(name);
}

async function until(what, seconds, holds) {
  const end = Date.now() + seconds * 1000;
  while (!(await holds())) {
    assert.ok(!interrupted, "interrupted");
    if (Date.now() > end) {
      for (const name of started) console.error(`== ${name}: ${state(name)}\n${logs(name).split("\n").slice(-15).join("\n")}`);
      assert.fail(`not within ${seconds} s: ${what}`);
    }
    for (const name of started) {
      const over = !["etude-policy", "etude-gateway"].includes(name);  // when their work is done
      const now = state(name);
      assert.ok(!now.startsWith("exited") || (over && now === "exited 0"), `${name}: ${now}\n${logs(name)}`);
    }
    await after(200);
  }
}

const data = () => join(place, "etude-data/quickstart");
const committed = () =>
  existsSync(join(data(), "data/episodes"))
    ? readdirSync(join(data(), "data/episodes"), {recursive: true}).filter((name) => name.endsWith(".hdf5")).length : 0;

async function trial() {
  const subnet = done("network", "inspect", "--format", "{{range .Subnets}}{{.Subnet}}{{end}}", network);
  const address = (host) => subnet.replace(/\.0\/24$/, `.${host}`);
  assert.notEqual(address(9), subnet, `a network of 256 addresses, not ${subnet}`);
  ["etude-collector", "etude-worker", "etude-trainer", "etude-policy", "etude-gateway"]
    .forEach((name, i) => start(name, address(10 + i)));
  await until("a quarter of the campaign", 300, () => committed() >= episodes / 4);

  // its node is gone: another pod of the same volume, at another address
  remove("etude-collector", "KILL");
  const before = committed();
  assert.ok(before < episodes, "the campaign was over before its collector was taken away");
  start("etude-collector", address(20));
  // the worker's probe notices, and the kubelet starts the container again
  const {livenessProbe} = workloads.find((r) => r.metadata.name === "etude-worker").spec.template.spec.containers[0];
  await until("the worker's probe fails", 60,
              () => podman("exec", container("etude-worker"), ...livenessProbe.exec.command).status !== 0);
  done("restart", "--time", "60", container("etude-worker"));
  await until("the worker knows the new hubs", 60,
              () => podman("exec", container("etude-worker"), ...livenessProbe.exec.command).status === 0);
  await until("the campaign is complete", 300, () => state("etude-collector") === "exited 0");
  const verified = JSON.parse(run(address(30), "etude", "dataset", "verify", "/data/quickstart/data", "--keep", "--json"));
  assert.equal(verified.good, episodes, JSON.stringify(verified));
  assert.deepEqual(verified.bad, []);

  await until("the run is trained", 300, () => state("etude-trainer") === "exited 0");
  // who subscribes now gets the checkpoint from the policy server's relay
  run(address(30), "etude", "checkpoint", "watch", "--run", "quickstart", "--channel", "latest", "--once", "--out",
      "/data/quickstart/watched");
  assert.equal(readdirSync(join(data(), "watched")).length, 1);

  const ask = async (path, headers) =>
    await fetch(`http://${address(14)}:8080${path}`, {headers}).catch(() => ({status: 0}));
  const page = await ask("/", {});
  assert.match(await page.text(), /<title>/);
  assert.equal((await ask("/api/v1/home", {})).status, 401, "nothing without the token");
  const home = await ask("/api/v1/home", {Authorization: `Bearer ${token}`});
  assert.equal(home.status, 200);
  assert.match(JSON.stringify(await home.json()), /quickstart/);

  for (const name of ["etude-policy", "etude-gateway"]) {
    done("stop", "--time", "60", container(name));
    assert.equal(state(name), "exited 0", `${name} when it is told to stop\n${logs(name)}`);
  }
  console.log(`pods: ${verified.good} of ${episodes} episodes, ${before} of them before the collector moved; trained, served, shown`);
}

try {
  done("network", "create", network);
  await trial();
} finally {
  for (const name of started) podman("rm", "--force", "--time", "0", container(name));
  podman("rm", "--force", "--time", "0", container("etude-check"));
  podman("network", "rm", "--force", network);
  rmSync(place, {recursive: true, force: true});
}

// SPDX-License-Identifier: Apache-2.0
// Checks deploy/kubernetes against the API's types as kubernetes-models has them, made of Kubernetes' OpenAPI description: by
// its schemas (values), and by its TypeScript interfaces (fields that there are not); then what neither knows: that names fit
// each other and that pods are as closed as the namespace demands.
//   npm ci && npm test
import assert from "node:assert/strict";
import {spawnSync} from "node:child_process";
import {existsSync, mkdirSync, mkdtempSync, readFileSync, rmSync, writeFileSync} from "node:fs";
import {tmpdir} from "node:os";
import {dirname, join} from "node:path";
import {fileURLToPath} from "node:url";
import ts from "typescript";
import {files, find, kustomization, resources, root, workloads} from "./manifests.mjs";

const modulePath = ({apiVersion}) => `kubernetes-models/${apiVersion}`;

// Values, by the class of its kind.
async function validate({file, ...resource}) {
  const module = await import(modulePath(resource));
  assert.ok(module[resource.kind], `${file}: no ${resource.kind} in ${resource.apiVersion}`);
  try {
    new module[resource.kind](resource).validate();
  } catch (error) {
    assert.fail(`${file}: ${resource.kind} ${resource.metadata?.name}: ${error.message}`);
  }
}

// Fields, by the compiler: a literal of an interface may have no others.
function typeErrors(all) {
  const source = all.map(
    ({file, ...resource}, i) =>
      `import type {I${resource.kind} as T${i}} from "${modulePath(resource)}";\n` +
      `export const r${i}: T${i} = ${JSON.stringify(resource)};\n`);
  const place = join(dirname(fileURLToPath(import.meta.url)), "node_modules/.resources");
  mkdirSync(place, {recursive: true});
  const name = join(place, "resources.ts");
  writeFileSync(name, source.join(""));
  const options = {noEmit: true, strict: true, skipLibCheck: true, module: ts.ModuleKind.NodeNext,
                   moduleResolution: ts.ModuleResolutionKind.NodeNext};
  return ts.getPreEmitDiagnostics(ts.createProgram([name], options))
    .map((problem) => ts.flattenDiagnosticMessageText(problem.messageText, "\n"));
}

// Each check must be able to fail.
async function validatorWorks() {
  const wrong = {file: "-", apiVersion: "apps/v1", kind: "Deployment", metadata: {name: "x"}, spec: {replicas: "three"}};
  await assert.rejects(validate(wrong));
  const misspelt = {file: "-", apiVersion: "v1", kind: "Service", metadata: {name: "x"}, spec: {port: []}};
  assert.match(typeErrors([misspelt]).join(), /port.' does not exist/);
}

function checkPods({file, kind, metadata, spec}) {
  const where = `${file}: ${kind} ${metadata.name}`;
  const pod = spec.template.spec;
  const labels = spec.template.metadata.labels;
  for (const [key, value] of Object.entries(spec.selector.matchLabels)) assert.equal(labels[key], value, where);
  assert.equal(labels["app.kubernetes.io/part-of"], "etude", where);
  if (kind === "StatefulSet") assert.ok(find("Service", spec.serviceName), where);
  assert.equal(pod.securityContext.runAsNonRoot, true, where);
  assert.equal(pod.securityContext.seccompProfile.type, "RuntimeDefault", where);
  const volumes = new Set(pod.volumes.map((volume) => volume.name));
  for (const volume of pod.volumes) {
    if (volume.configMap) assert.ok(find("ConfigMap", volume.configMap.name), where);
    if (volume.persistentVolumeClaim) assert.ok(find("PersistentVolumeClaim", volume.persistentVolumeClaim.claimName), where);
  }
  // a container that is started again must ask for the hubs again, which init containers would not
  assert.ok(!pod.initContainers, where);
  for (const container of pod.containers) {
    assert.deepEqual(container.command.slice(0, 2), ["/bin/sh", "/etc/etude/bus/start"], where);
    for (const mount of container.volumeMounts) assert.ok(volumes.has(mount.name), `${where}: volume ${mount.name}`);
    assert.equal(container.securityContext.allowPrivilegeEscalation, false, where);
    assert.deepEqual(container.securityContext.capabilities.drop, ["ALL"], where);
    assert.equal(container.securityContext.readOnlyRootFilesystem, true, where);
  }
  for (const container of pod.containers) assert.ok(container.resources.limits.memory, where);
  // whoever is no hub must notice when the hubs change; a hub waits until it is listed itself
  const address = pod.containers[0].env.find(({name}) => name === "ETUDE_HUB")?.valueFrom.fieldRef.fieldPath;
  if (labels["etude.dev/hub"] === "true") assert.equal(address, "status.podIP", where);
  else assert.ok(pod.containers[0].livenessProbe && !address, where);
  // a campaign that comes with the programs is named as it is installed
  for (const word of pod.containers[0].command)
    if (word.startsWith("/usr/share/etude/")) assert.ok(existsSync(join(root, "deploy", word.slice(17))), `${where}: ${word}`);
}

// The scripts of network.yaml, with programs in the place of DNS and of `etude`: a container whose hubs move comes to the new
// ones by being started again.
function scriptsFollowHubs() {
  const place = mkdtempSync(join(tmpdir(), `etude-test-${process.pid}-`));
  const scripts = find("ConfigMap", "etude-bus").data;
  for (const [name, text] of Object.entries(scripts)) writeFileSync(join(place, name), text.replaceAll("/run/etude", place));
  const program = (name, text) => writeFileSync(join(place, name), `#!/bin/sh\n${text}\n`, {mode: 0o755});
  program("getent", `cat "${place}/dns"; [ -s "${place}/dns" ]`);
  program("etude", `echo "\${CYCLONEDDS_URI-none} $*" >"${place}/profile"`);
  const dns = (...hubs) => writeFileSync(join(place, "dns"), hubs.map((hub) => `${hub} STREAM etude-hubs\n${hub} DGRAM\n`).join(""));
  const runAs = (hub, ...words) =>
    spawnSync("/bin/sh", words.map((word, i) => (i ? word : join(place, word))),
              {env: {...process.env, PATH: `${place}:${process.env.PATH}`, CYCLONEDDS_URI: "file:///no", ETUDE_HUB: hub},
               encoding: "utf8"});
  const run = (...words) => runAs("", ...words);
  const profile = () => readFileSync(join(place, "profile"), "utf8").trim().replace(place, "");
  try {
    dns("10.0.0.2", "10.0.0.1");
    assert.equal(run("same-hubs").status, 0, "it has not begun: nothing is wrong yet");
    const started = run("start", "/bin/sh", "-c", 'echo "$1"; exit 7', "-", "two words");
    assert.deepEqual([started.stdout, started.status], ["two words\n", 7], started.stderr);
    assert.equal(profile(), "none doctor net --write-profile /dds.xml --hub 10.0.0.1 --hub 10.0.0.2");
    assert.equal(run("same-hubs").status, 0);
    dns();
    assert.equal(run("same-hubs").status, 0, "no answer is no other hub");
    dns("10.0.0.3", "10.0.0.1");
    assert.notEqual(run("same-hubs").status, 0);
    assert.equal(run("start", "true").status, 0);
    assert.equal(profile(), "none doctor net --write-profile /dds.xml --hub 10.0.0.1 --hub 10.0.0.3");
    assert.equal(run("same-hubs").status, 0);
    // the second answer has it, and another one that came meanwhile
    dns("10.0.0.1");
    program("sleep", `printf '10.0.0.3 STREAM x\\n10.0.0.2 STREAM x\\n' >>"${place}/dns"`);
    assert.equal(runAs("10.0.0.2", "start", "true").stdout, "waiting for a hub\n");
    assert.equal(profile(), "none doctor net --write-profile /dds.xml --hub 10.0.0.1 --hub 10.0.0.2 --hub 10.0.0.3");
  } finally {
    rmSync(place, {recursive: true});
  }
}

await validatorWorks();
scriptsFollowHubs();
for (const resource of resources) await validate(resource);
assert.deepEqual(typeErrors(resources), []);
assert.equal(workloads.length, 5);
workloads.forEach(checkPods);
assert.equal(find("Service", "etude-hubs").spec.clusterIP, "None");
assert.deepEqual([...kustomization.resources].sort(), [...files].sort(), "kustomization.yaml lists every file");
console.log(`${resources.length} resources in ${files.length} files fit Kubernetes' API`);

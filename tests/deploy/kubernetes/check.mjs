// SPDX-License-Identifier: Apache-2.0
// Checks deploy/kubernetes against the API's types as kubernetes-models has them, made of Kubernetes' OpenAPI description: by
// its schemas (values), and by its TypeScript interfaces (fields that there are not); then what neither knows: that names fit
// each other and that pods are as closed as the namespace demands.
//   npm ci && npm test
import assert from "node:assert/strict";
import {existsSync, mkdirSync, readFileSync, readdirSync, writeFileSync} from "node:fs";
import {dirname, join} from "node:path";
import {fileURLToPath} from "node:url";
import ts from "typescript";
import {parseAllDocuments} from "yaml";

const root = join(dirname(fileURLToPath(import.meta.url)), "../../..");
const folder = join(root, "deploy/kubernetes");
const files = readdirSync(folder).filter((name) => name.endsWith(".yaml") && name !== "kustomization.yaml");

const resources = [];
for (const file of files)
  for (const document of parseAllDocuments(readFileSync(join(folder, file), "utf8"), {version: "1.2"})) {
    assert.deepEqual(document.errors, [], file);
    resources.push({file, ...document.toJS()});
  }

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

const named = (kind, name) => resources.some((r) => r.kind === kind && r.metadata.name === name);

function checkPods({file, kind, metadata, spec}) {
  const where = `${file}: ${kind} ${metadata.name}`;
  const pod = spec.template.spec;
  const labels = spec.template.metadata.labels;
  for (const [key, value] of Object.entries(spec.selector.matchLabels)) assert.equal(labels[key], value, where);
  assert.equal(labels["app.kubernetes.io/part-of"], "etude", where);
  if (kind === "StatefulSet") assert.ok(named("Service", spec.serviceName), where);
  assert.equal(pod.securityContext.runAsNonRoot, true, where);
  assert.equal(pod.securityContext.seccompProfile.type, "RuntimeDefault", where);
  const volumes = new Set(pod.volumes.map((volume) => volume.name));
  for (const volume of pod.volumes) {
    if (volume.configMap) assert.ok(named("ConfigMap", volume.configMap.name), where);
    if (volume.persistentVolumeClaim) assert.ok(named("PersistentVolumeClaim", volume.persistentVolumeClaim.claimName), where);
  }
  for (const container of [...pod.initContainers, ...pod.containers]) {
    for (const mount of container.volumeMounts) assert.ok(volumes.has(mount.name), `${where}: volume ${mount.name}`);
    assert.equal(container.securityContext.allowPrivilegeEscalation, false, where);
    assert.deepEqual(container.securityContext.capabilities.drop, ["ALL"], where);
    assert.equal(container.securityContext.readOnlyRootFilesystem, true, where);
  }
  for (const container of pod.containers) assert.ok(container.resources.limits.memory, where);
  // whoever is no hub must notice when the hubs change
  if (labels["etude.dev/hub"] !== "true") assert.ok(pod.containers[0].livenessProbe, where);
  // a campaign that comes with the programs is named as it is installed
  for (const word of pod.containers[0].command)
    if (word.startsWith("/usr/share/etude/")) assert.ok(existsSync(join(root, "deploy", word.slice(17))), `${where}: ${word}`);
}

await validatorWorks();
for (const resource of resources) await validate(resource);
assert.deepEqual(typeErrors(resources), []);
const workloads = resources.filter((r) => ["Deployment", "StatefulSet"].includes(r.kind));
assert.equal(workloads.length, 5);
workloads.forEach(checkPods);
const hubs = resources.find((r) => r.kind === "Service" && r.metadata.name === "etude-hubs");
assert.equal(hubs.spec.clusterIP, "None");
const listed = parseAllDocuments(readFileSync(join(folder, "kustomization.yaml"), "utf8"))[0].toJS().resources;
assert.deepEqual([...listed].sort(), [...files].sort(), "kustomization.yaml lists every file");
console.log(`${resources.length} resources in ${files.length} files fit Kubernetes' API`);

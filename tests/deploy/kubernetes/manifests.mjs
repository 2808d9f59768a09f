// SPDX-License-Identifier: Apache-2.0
// What deploy/kubernetes declares, read once for both checks.
import assert from "node:assert/strict";
import {readFileSync, readdirSync} from "node:fs";
import {dirname, join} from "node:path";
import {fileURLToPath} from "node:url";
import {parseAllDocuments} from "yaml";

export const root = join(dirname(fileURLToPath(import.meta.url)), "../../..");
const folder = join(root, "deploy/kubernetes");

export const files = readdirSync(folder).filter((name) => name.endsWith(".yaml") && name !== "kustomization.yaml");
export const kustomization = parseAllDocuments(readFileSync(join(folder, "kustomization.yaml"), "utf8"))[0].toJS();

// {file, apiVersion, kind, metadata, ...} each
export const resources = [];
for (const file of files)
  // 1.1, as Kubernetes reads them: 0440 is octal
  for (const document of parseAllDocuments(readFileSync(join(folder, file), "utf8"), {version: "1.1"})) {
    assert.deepEqual(document.errors, [], file);
    resources.push({file, ...document.toJS()});
  }

export const find = (kind, name) => resources.find((r) => r.kind === kind && r.metadata.name === name);
export const workloads = resources.filter((r) => ["Deployment", "StatefulSet"].includes(r.kind));

// SPDX-License-Identifier: Apache-2.0
// Prints as JSON what others' readers see in a Parquet file: node read_parquet.mjs hyparquet | parquet-wasm FILE
// Whole numbers of 64 bits become texts. Exit code 77: the reader is not there; both are looked for beside this file, in
// dashboard/web (npm ci), and in ETUDE_NODE_MODULES.
import { existsSync, readFileSync } from 'node:fs'
import { createRequire } from 'node:module'
import { dirname, join } from 'node:path'
import { fileURLToPath, pathToFileURL } from 'node:url'

const [reader, path] = process.argv.slice(2)
const here = dirname(fileURLToPath(import.meta.url))
const places = [
  process.env.ETUDE_NODE_MODULES,
  join(here, 'node_modules'),
  join(here, '../../../dashboard/web/node_modules'),
]
const folder = places.find((place) => place && existsSync(join(place, reader, 'package.json')))
if (!folder) process.exit(77)

async function withHyparquet() {
  const entry = JSON.parse(readFileSync(join(folder, 'hyparquet/package.json'))).exports['.']
  const file = typeof entry === 'string' ? entry : (entry.default?.default ?? entry.default ?? entry.import)
  const { asyncBufferFromFile, parquetMetadataAsync, parquetReadObjects } = await import(
    pathToFileURL(join(folder, 'hyparquet', file))
  )
  const buffer = await asyncBufferFromFile(path)
  const footer = await parquetMetadataAsync(buffer)
  return {
    rows: await parquetReadObjects({ file: buffer }),
    metadata: Object.fromEntries((footer.key_value_metadata ?? []).map(({ key, value }) => [key, value])),
    columns: footer.row_groups[0]?.columns.map((column) => column.meta_data.path_in_schema[0]) ?? [],
  }
}

// Arrow's own Parquet code, compiled for JavaScript; its rows come as Arrow's stream format
function withParquetWasm() {
  const require = createRequire(join(folder, 'any.cjs'))
  const { readParquet } = require('parquet-wasm')
  const { tableFromIPC } = require('apache-arrow')
  const table = tableFromIPC(readParquet(new Uint8Array(readFileSync(path))).intoIPCStream())
  const value = (cell) => {
    if (cell === null || typeof cell !== 'object') return cell
    if (typeof cell.toJSON === 'function') return value(cell.toJSON())
    if (Array.isArray(cell) || ArrayBuffer.isView(cell)) return Array.from(cell, value)
    return Object.fromEntries(Object.entries(cell).map(([key, part]) => [key, value(part)]))
  }
  return {
    rows: table.toArray().map(value),
    metadata: Object.fromEntries(table.schema.metadata),
    columns: table.schema.fields.map((field) => field.name),
  }
}

const seen = await { hyparquet: withHyparquet, 'parquet-wasm': withParquetWasm }[reader]()
const plain = (key, value) => (typeof value === 'bigint' ? value.toString() : value)
process.stdout.write(JSON.stringify(seen, plain))

// SPDX-License-Identifier: Apache-2.0
// Prints as JSON what hyparquet sees in a Parquet file: node read_parquet.mjs FILE
// Whole numbers of 64 bits become texts. Exit code 77: no hyparquet; it is looked for beside this file, in
// dashboard/web, and in ETUDE_NODE_MODULES.
import { existsSync, readFileSync } from 'node:fs'
import { dirname, join } from 'node:path'
import { fileURLToPath, pathToFileURL } from 'node:url'

const here = dirname(fileURLToPath(import.meta.url))
const places = [
  process.env.ETUDE_NODE_MODULES,
  join(here, 'node_modules'),
  join(here, '../../../dashboard/web/node_modules'),
]
const folder = places.find((place) => place && existsSync(join(place, 'hyparquet/package.json')))
if (!folder) process.exit(77)

const entry = JSON.parse(readFileSync(join(folder, 'hyparquet/package.json'))).exports['.']
const path = typeof entry === 'string' ? entry : (entry.default?.default ?? entry.default ?? entry.import)
const { asyncBufferFromFile, parquetMetadataAsync, parquetReadObjects } = await import(
  pathToFileURL(join(folder, 'hyparquet', path))
)

const file = await asyncBufferFromFile(process.argv[2])
const footer = await parquetMetadataAsync(file)
const rows = await parquetReadObjects({ file })
const metadata = Object.fromEntries((footer.key_value_metadata ?? []).map(({ key, value }) => [key, value]))
const columns = footer.row_groups[0]?.columns.map((column) => column.meta_data.path_in_schema[0]) ?? []
const plain = (key, value) => (typeof value === 'bigint' ? value.toString() : value)
process.stdout.write(JSON.stringify({ rows, metadata, columns }, plain))

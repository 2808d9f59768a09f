// SPDX-License-Identifier: Apache-2.0
// Reads safetensors: u64 length, a JSON header of that length, then the tensors' bytes.

export type Numbers = Float32Array | Float64Array | Uint8Array | Int32Array | Uint32Array;
export interface Tensor { shape: number[]; values: Numbers }
export interface Tensors { tensors: Map<string, Tensor>; metadata: Record<string, string> }

interface Entry { dtype: string; shape: number[]; data_offsets: [number, number] }

export function readSafetensors(buffer: ArrayBuffer): Tensors {
  const length = Number(new DataView(buffer).getBigUint64(0, true));
  if (8 + length > buffer.byteLength) throw new Error(`safetensors header of ${length} bytes in an answer of ${buffer.byteLength}`);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 8, length))) as Record<string, Entry>;
  const tensors = new Map<string, Tensor>();
  for (const [name, entry] of Object.entries(header)) {
    if (name === '__metadata__') continue;
    // slice copies, which puts the values on the boundary that a typed array needs
    const raw = buffer.slice(8 + length + entry.data_offsets[0], 8 + length + entry.data_offsets[1]);
    tensors.set(name, { shape: entry.shape, values: view(entry.dtype, raw) });
  }
  return { tensors, metadata: (header['__metadata__'] ?? {}) as unknown as Record<string, string> };
}

function view(dtype: string, raw: ArrayBuffer): Numbers {
  switch (dtype) {
    case 'F32': return new Float32Array(raw);
    case 'F64': return new Float64Array(raw);
    case 'U8': case 'BOOL': return new Uint8Array(raw);
    case 'I32': return new Int32Array(raw);
    case 'U32': return new Uint32Array(raw);
    case 'I64': return Float64Array.from(new BigInt64Array(raw), Number);
    case 'U64': return Float64Array.from(new BigUint64Array(raw), Number);
    default: throw new Error(`safetensors: dtype ${dtype} is not read here`);
  }
}

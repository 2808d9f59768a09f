# SPDX-License-Identifier: Apache-2.0
# What is in a checkpoint, without any library but numpy: python3 read_checkpoint.py FILE.safetensors
import json
import sys

import numpy

with open(sys.argv[1], "rb") as file:
    header = json.loads(file.read(int.from_bytes(file.read(8), "little")))
    data = file.read()
print("run", header.pop("__metadata__", {}).get("run"), "of", len(header), "tensors")
types = {"F32": numpy.float32, "I64": numpy.int64, "F64": numpy.float64, "U8": numpy.uint8, "BOOL": numpy.bool_}
for name, entry in header.items():
    begin, end = entry["data_offsets"]
    tensor = numpy.frombuffer(data[begin:end], types[entry["dtype"]]).reshape(entry["shape"])
    print(name, tensor.dtype, tensor.shape, float(numpy.abs(tensor).mean()) if tensor.size else 0.0)

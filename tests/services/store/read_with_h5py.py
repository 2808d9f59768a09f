# SPDX-License-Identifier: Apache-2.0
"""Prints as JSON what h5py sees in an HDF5 file: python3 read_with_h5py.py FILE GROUP

An independent reader of what services/store writes; interop_test.cc compares. Exit code 77: no h5py.
"""
import hashlib
import json
import sys

try:
    import h5py
except ImportError:
    sys.exit(77)


def attributes(node):
    plain = {}
    for key, value in node.attrs.items():
        value = value.tolist() if hasattr(value, "tolist") else value
        plain[key] = value.decode() if isinstance(value, bytes) else value
    return plain


with h5py.File(sys.argv[1], "r") as file:
    group = file[sys.argv[2]]
    seen = {"attributes": attributes(group), "data": attributes(file["data"]), "arrays": {}, "values": {}}

    def visit(name, node):
        if not isinstance(node, h5py.Dataset):
            return
        array = node[()]
        seen["arrays"][name] = [str(node.dtype), list(node.shape), node.chunks and list(node.chunks), node.compression]
        if array.dtype.kind in "fiu" and array.ndim <= 2:
            seen["values"][name] = array.tolist()
        else:
            seen["values"][name] = [hashlib.sha256(row.tobytes()).hexdigest() for row in array]

    group.visititems(visit)
    seen["demos"] = sorted(file["data"].keys())
    seen["mask"] = {key: [name.decode() for name in file["mask"][key][()]] for key in file["mask"]} if "mask" in file else {}
    print(json.dumps(seen))

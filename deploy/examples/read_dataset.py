# SPDX-License-Identifier: Apache-2.0
# Every demonstration of a dataset with h5py: python3 read_dataset.py DATASET/dataset.hdf5
import sys

import h5py

with h5py.File(sys.argv[1], "r") as file:
    for name in sorted(file["data"], key=lambda demo: int(demo[5:])):
        demo = file["data"][name]
        picture = demo["obs/front_image"][0]  # (height, width, 3) uint8
        print(name, demo.attrs["instruction"], demo["actions_abs"].shape, picture.shape, demo["obs/robot0_eef_pos"][-1])

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <sys/mount.h>

#include <string>
#include <utility>

#include "services/core/file.h"

namespace etude {

/// A tmpfs of its own over a folder, for as long as this lives. Needs root: look whether it is mounted.
class SmallDisk {
 public:
  /// @param size  as tmpfs takes it: "16m", bytes
  SmallDisk(Path folder, const std::string& size) : folder_(std::move(folder)) {
    EXPECT_TRUE(MakeFolders(folder_));
    mounted_ = ::mount("tmpfs", folder_.c_str(), "tmpfs", 0, ("size=" + size).c_str()) == 0;
  }
  ~SmallDisk() {
    if (mounted_) ::umount2(folder_.c_str(), MNT_DETACH);
  }
  SmallDisk(const SmallDisk&) = delete;
  SmallDisk& operator=(const SmallDisk&) = delete;

  bool mounted() const { return mounted_; }
  /// What is there stays.
  bool Grow(const std::string& size) const {
    return ::mount(nullptr, folder_.c_str(), nullptr, MS_REMOUNT, ("size=" + size).c_str()) == 0;
  }

 private:
  Path folder_;
  bool mounted_ = false;
};

}  // namespace etude

// SPDX-License-Identifier: Apache-2.0
// A policy whose language is a small CLIP's.
#pragma once

#include <string>

#include "tests/trainer/policy/clip/tiny_clip.h"
#include "tests/trainer/policy/fixtures.h"
#include "trainer/policy/clip/text_encoder.h"

namespace etude::policy {

/// `config` with the language of `folder`, which holds CLIP's files, resolved as training does it.
inline PolicyConfig WithClip(const Path& folder, PolicyConfig config = TinyConfig()) {
  const auto encoder = clip::TextEncoder::Open(folder);
  EXPECT_TRUE(encoder) << encoder.error().message;
  config.language = {.encoder = "clip:" + folder.string(), .sha256 = encoder ? (*encoder)->sha256() : ""};
  return config;
}

}  // namespace etude::policy

// SPDX-License-Identifier: Apache-2.0
// What the bytes of this machine's episodes depend on, so that two machines can be compared line by line.
#pragma once

#include <map>
#include <string>
#include <utility>

#include "services/campaign/fingerprint.h"
#include "services/core/result.h"
#include "services/core/thread_annotations.h"
#include "services/spec/campaign_spec.h"
#include "worker/sim/renderer.h"

namespace etude {

/// content number; libraries that are loaded, by the names of their files; the GL driver, without the width of its
/// vectors, which changes no picture (but on a GPU there is none); SHA-256 of a rendered
/// picture, of a simulation's states, of the results of libm on a fixed list of arguments, and of what libdeflate
/// makes of fixed bytes: its streams are what an episode holds.
/// @error as Renderer::Open, Scene::Build
Result<campaign::Fingerprint> TakeFingerprint(const sim::RendererConfig& renderer);

/// This machine's fingerprints for the campaigns that it joins, each taken when it is first asked for: it depends on
/// who draws. Thread-safe.
class Fingerprints {
 public:
  explicit Fingerprints(sim::RendererConfig base) : base_(std::move(base)) {}
  /// @error as TakeFingerprint
  Result<campaign::Fingerprint> Of(const CampaignSpec& spec) ETUDE_EXCLUDES(mutex_);

 private:
  const sim::RendererConfig base_;
  Mutex mutex_;
  std::map<std::pair<std::string, int>, campaign::Fingerprint> taken_ ETUDE_GUARDED_BY(mutex_);  // renderer, device
};

/// Of libm alone: what differs between CPUs of one C library.
std::string LibmProbe();

}  // namespace etude

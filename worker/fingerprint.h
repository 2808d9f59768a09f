// SPDX-License-Identifier: Apache-2.0
// What the bytes of this machine's episodes depend on, so that two machines can be compared line by line.
#pragma once

#include <string>

#include "services/campaign/fingerprint.h"
#include "services/core/result.h"
#include "worker/sim/renderer.h"

namespace etude {

/// content number; libraries that are loaded, by the names of their files; the GL driver, without the width of its
/// vectors, which changes no picture (but on a GPU there is none); SHA-256 of a rendered
/// picture, of a simulation's states, of the results of libm on a fixed list of arguments.
/// @error as Renderer::Open, Scene::Build
Result<campaign::Fingerprint> TakeFingerprint(const sim::RendererConfig& renderer);

/// Of libm alone: what differs between CPUs of one C library.
std::string LibmProbe();

}  // namespace etude

// SPDX-License-Identifier: Apache-2.0
// Headless rendering: in software by EGL (surfaceless) and, where that fails, OSMesa; or on a GPU by EGL.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "services/spec/campaign_spec.h"
#include "worker/sim/appearance.h"
#include "worker/sim/world.h"

namespace etude::sim {

struct RendererConfig {
  std::string backend = "auto";  ///< auto | egl | osmesa
  int samples = 0;               ///< multisamples; 0 is 3x faster than 4 at SSIM 0.957 instead of 0.966
                                 ///< (measured: tests/bench/render_quality_bench.cc)
  bool shadows = false;
  /// software: the same pictures on every host | gpu: a GPU's driver draws, or there is no renderer
  std::string renderer = "software";
  int device = -1;  ///< with renderer gpu: its number in EGL's list; -1: the first that draws
};

/// `base`, drawn as `spec` asks for it.
RendererConfig RendererFor(const CampaignSpec& spec, RendererConfig base = {});

/// A GL context, its framebuffer and MuJoCo's render state. Use from the thread that made it only.
/// A picture is a function of the world's state, the appearance, the camera and the GL driver: the same bytes each
/// time.
class Renderer {
 public:
  /// @error kUnavailable: no GL, or no GPU where one is asked for; says what was tried, which devices there are and
  /// what to install.
  static Result<Renderer> Open(std::shared_ptr<const Scene> scene, const RendererConfig& config = {});
  Renderer(Renderer&&) noexcept;
  Renderer& operator=(Renderer&&) noexcept;
  ~Renderer();

  /// Light and colours from now on; the default is the scene as described.
  /// @pre the scene was built with its table (SceneSpec::tables) and with a backdrop, where it asks for them
  void SetAppearance(const Appearance& appearance);
  /// Where pictures are taken from, from now on; nothing: the scene's own camera.
  /// @pre its pictures are as large as those of the scene's camera
  void SetCamera(const std::optional<Camera>& camera);
  /// The camera that pictures are taken with now: what projects onto them has to use this one.
  const Camera& camera() const;

  /// Picture of the camera: RGB, camera.height * camera.width * 3 bytes, top row first.
  void Render(const World& world, std::span<std::uint8_t> rgb);
  /// Segmentation of the camera: body id per pixel, -1 background; top row first.
  void RenderSegmentation(const World& world, std::span<std::int32_t> body_ids);
  /// Depth of the camera: m along its viewing direction, one value a pixel, top row first; where
  /// nothing is drawn, the far plane.
  void RenderDepth(const World& world, std::span<float> depth);

  const std::string& backend() const;      ///< "egl" | "osmesa"
  const std::string& gl_renderer() const;  ///< what the driver calls itself

 private:
  struct Impl;
  explicit Renderer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace etude::sim

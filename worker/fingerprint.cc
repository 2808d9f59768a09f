// SPDX-License-Identifier: Apache-2.0
#include "worker/fingerprint.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gnu/libc-version.h>
#include <link.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <set>
#include <span>
#include <string_view>
#include <vector>

#include "services/codec/deflate.h"
#include "services/core/hash.h"
#include "services/spec/campaign_spec.h"
#include "services/spec/content_version.h"
#include "worker/sim/scene.h"
#include "worker/sim/world.h"

namespace etude {
namespace {

constexpr int kProbeSteps = 100;
constexpr int kArguments = 2000;

template <class Number>
void Add(Sha256& hash, Number number) {
  hash.Update(std::span(reinterpret_cast<const std::uint8_t*>(&number), sizeof number));
}

int NoteLibrary(dl_phdr_info* info, std::size_t, void* found) {
  static constexpr std::string_view kStems[] = {"libmujoco", "libompl", "libfcl", "libccd", "libm.so", "libm-"};
  std::error_code error;
  const auto file = std::filesystem::canonical(info->dlpi_name, error).filename().string();
  for (const std::string_view stem : kStems)
    if (file.starts_with(stem)) static_cast<std::set<std::string>*>(found)->insert(file);
  return 0;
}

std::string Libraries() {
  std::set<std::string> found;
  ::dl_iterate_phdr(NoteLibrary, &found);
  return fmt::format("glibc {}, {}", ::gnu_get_libc_version(), fmt::join(found, ", "));
}

// "llvmpipe (LLVM 15.0.6, 256 bits)": as wide as the CPU's vectors are; its pictures are the same.
std::string WithoutVectorWidth(std::string driver) {
  const auto end = driver.rfind(" bits)"), begin = driver.rfind(", ", end);
  if (driver.starts_with("llvmpipe") && end != std::string::npos && begin != std::string::npos)
    driver.erase(begin, end + std::string_view(" bits").size() - begin);
  return driver;
}

// Joints, objects and contacts of an arm that presses on what it meets.
std::string PhysicsProbe(sim::World& world) {
  world.Reset();
  world.Forward();
  Waypoint target{world.X_WE(), 0};
  Sha256 hash;
  for (int step = 0; step < kProbeSteps; ++step) {
    target.X_WE.p.z() -= 0.002;
    target.gripper = step > kProbeSteps / 2 ? 1 : 0;
    world.Step(target, Eigen::Matrix<double, 6, 1>::Zero());
    for (const double angle : world.q()) Add(hash, angle);
    for (const float number : world.StateVector()) Add(hash, number);
  }
  return ToHex(hash.Finish());
}

// Of bytes that no renderer drew: runs, slopes and what looks like noise.
std::string DeflateProbe() {
  std::vector<std::uint8_t> bytes(3 * 224 * 224);
  std::uint32_t state = 1;
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    state = state * 1664525 + 1013904223;
    const std::size_t part = 3 * i / bytes.size();
    bytes[i] = static_cast<std::uint8_t>(part == 0 ? i / 97 : part == 1 ? i * i >> 9 : state >> 24);
  }
  return Sha256Hex(codec::Deflate(bytes));
}

}  // namespace

std::string LibmProbe() {
  Sha256 hash;
  for (int k = 1; k <= kArguments; ++k) {
    // spread over magnitudes, and not known to the compiler
    volatile double argument = 0.37 * k * std::ldexp(1.0, k % 24 - 16);
    const double x = argument;
    for (const double y :
         {std::sin(x), std::cos(x), std::tan(x), std::atan(x), std::exp(-x), std::log(x), std::pow(x, 0.7),
          std::atan2(x, 1.3), std::sqrt(x), std::asin(std::fmod(x, 1.0)), std::acos(std::fmod(x, 1.0)),
          std::hypot(x, 0.3), std::cbrt(x), std::sinh(std::fmod(x, 5.0))})
      Add(hash, std::bit_cast<std::uint64_t>(y));
    const auto f = static_cast<float>(x);
    for (const float y : {std::sin(f), std::cos(f), std::exp(-f), std::log(f), std::pow(f, 0.7f)})
      Add(hash, std::bit_cast<std::uint32_t>(y));
  }
  return ToHex(hash.Finish());
}

Result<campaign::Fingerprint> TakeFingerprint(const sim::RendererConfig& config) {
  ETUDE_ASSIGN_OR_RETURN(const auto scene, sim::Scene::Build(SceneSpec{}));
  ETUDE_ASSIGN_OR_RETURN(auto renderer, sim::Renderer::Open(scene, config));
  sim::World world(scene);
  const std::string physics = PhysicsProbe(world);
  world.Reset();
  world.Forward();
  std::vector<std::uint8_t> rgb(static_cast<std::size_t>(scene->camera().width) * scene->camera().height * 3);
  renderer.Render(world, rgb);
  return campaign::Fingerprint{{"content", std::to_string(kContentVersion)},
                               {"libraries", Libraries()},
                               {"gl", WithoutVectorWidth(renderer.gl_renderer())},
                               {"picture", Sha256Hex(rgb)},
                               {"physics", physics},
                               {"libm", LibmProbe()},
                               {"deflated", DeflateProbe()}};
}

Result<campaign::Fingerprint> Fingerprints::Of(const CampaignSpec& spec) {
  const MutexLock lock(mutex_);
  const std::pair key(spec.renderer, spec.device);
  if (const auto known = taken_.find(key); known != taken_.end()) return known->second;
  ETUDE_ASSIGN_OR_RETURN(auto fingerprint, TakeFingerprint(sim::RendererFor(spec, base_)));
  return taken_[key] = std::move(fingerprint);
}

}  // namespace etude

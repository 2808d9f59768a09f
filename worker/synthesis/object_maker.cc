// SPDX-License-Identifier: Apache-2.0
#include "worker/synthesis/object_maker.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <exception>
#include <mutex>
#include <optional>
#include <thread>

#include "services/core/stop.h"
#include "services/core/without_throwing.h"
#include "worker/synthesis/mesh_file.h"
#include "worker/synthesis/picture_file.h"

namespace etude::synthesis {

Result<SolidObject> ImportObject(const Path& file, const ImportOptions& options) {
  if (!IsPlainName(options.name))
    return Fail(Code::kInvalidArgument,
                fmt::format("import as '{}': a name is made of a-z, 0-9, _ and -, at most 64", options.name));
  ETUDE_ASSIGN_OR_RETURN(FileMesh read, ReadMesh(file));
  if (options.up == UpAxis::kY) {
    const auto turn = [](const Eigen::Vector3d& p) { return Eigen::Vector3d(p.x(), -p.z(), p.y()); };
    std::transform(read.mesh.positions.begin(), read.mesh.positions.end(), read.mesh.positions.begin(), turn);
    std::transform(read.mesh.normals.begin(), read.mesh.normals.end(), read.mesh.normals.begin(), turn);
  }
  ObjectFacts facts{
      .name = options.name, .class_name = options.name, .source = file.filename().string(), .size_m = options.size_m};
  ETUDE_ASSIGN_OR_RETURN(SolidObject object, PlaceObject(std::move(facts), std::move(read.mesh), std::nullopt,
                                                         {.density = options.density}));
  if (read.picture.empty())
    object.texture = PaletteTexture(read.palette);
  else {
    ETUDE_ASSIGN_OR_RETURN(object.texture, DecodePicture(read.picture, file.string()));
  }
  return object;
}

Result<std::vector<ObjectFacts>> MakeObjects(const std::vector<Maker>& makers, const Path& out, int threads,
                                             const std::function<void(const ObjectFacts&)>& made) {
  std::vector<std::optional<Result<ObjectFacts>>> results(makers.size());
  std::atomic<std::size_t> next = 0;
  std::atomic<bool> has_failed = false;
  std::mutex one_call;
  // nobody is above a thread: what it throws would end the program
  const auto make = [&](const Maker& maker) -> Result<ObjectFacts> {
    try {
      ETUDE_ASSIGN_OR_RETURN(const SolidObject object, maker());
      ETUDE_RETURN_IF_ERROR(WriteObject(object, out / object.facts.name));
      return object.facts;
    } catch (const std::exception& exception) {
      return Fail(Code::kInternal,
                  fmt::format("make an object for '{}': an exception: {}", out.string(), exception.what()));
    }
  };
  const auto work = [&] {
    for (std::size_t i = next++; i < makers.size() && !has_failed && !StopRequested(); i = next++) {
      results[i] = make(makers[i]);
      if (!*results[i]) has_failed = true;
      const std::lock_guard lock(one_call);
      if (*results[i]) made(**results[i]);
    }
  };
  std::vector<std::thread> workers;
  for (int k = 1; k < threads; ++k)  // the system may have no more of them: those that are there do all
    if (!WithoutThrowing([&]() -> Status { return workers.emplace_back(work), Status(); })) break;
  work();
  for (auto& worker : workers) worker.join();

  std::vector<ObjectFacts> facts;
  for (auto& result : results) {
    if (!result) continue;  // not begun: another failed, or asked to stop
    if (!*result) return Fail(std::move(*result).error());
    facts.push_back(std::move(**result));
  }
  return facts;
}

}  // namespace etude::synthesis

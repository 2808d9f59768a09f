// SPDX-License-Identifier: Apache-2.0
#include <fmt/ranges.h>

#include <algorithm>
#include <map>

#include "services/core/config.h"
#include "services/core/hash.h"
#include "services/store/edit.h"
#include "services/store/episode_file.h"
#include "services/store/filter_keys.h"
#include "services/store/layout.h"

namespace etude::store {
namespace {

namespace fs = std::filesystem;

struct Part {
  DatasetReader reader;
  std::vector<std::uint64_t> indices;
};

Result<std::vector<Part>> OpenParts(const std::vector<Path>& datasets) {
  if (datasets.size() < 2)
    return Fail(Code::kInvalidArgument, fmt::format("merge {} dataset(s): name at least two", datasets.size()));
  std::vector<Part> parts;
  for (const auto& dataset : datasets) {
    ETUDE_ASSIGN_OR_RETURN(auto reader, DatasetReader::Open(dataset));
    ETUDE_ASSIGN_OR_RETURN(auto indices, reader.List());
    parts.push_back({std::move(reader), std::move(indices)});
  }
  return parts;
}

bool OfOneSpec(const std::vector<Part>& parts) {
  return std::all_of(parts.begin(), parts.end(), [&](const Part& part) {
    return part.reader.spec_sha256() == parts[0].reader.spec_sha256() &&
           part.reader.schema_version() == parts[0].reader.schema_version();
  });
}

// Which dataset each episode comes from. @error where two have it, and not the same
Result<std::map<std::uint64_t, const Part*>> Owners(const std::vector<Part>& parts) {
  std::map<std::uint64_t, const Part*> owners;
  for (const Part& part : parts)
    for (const std::uint64_t index : part.indices) {
      ETUDE_RETURN_IF_ERROR(internal::CheckNotStopped(part.reader.path()));
      const auto [owner, added] = owners.emplace(index, &part);
      if (added) continue;
      const Path first = owner->second->reader.path(), second = part.reader.path();
      ETUDE_ASSIGN_OR_RETURN(const auto a, ReadBinaryFile(EpisodePath(first, index), internal::kMaxEpisodeFile));
      ETUDE_ASSIGN_OR_RETURN(const auto b, ReadBinaryFile(EpisodePath(second, index), internal::kMaxEpisodeFile));
      if (a != b)
        return Fail(
            Code::kInvalidArgument,
            fmt::format("merge: '{}' and '{}' are of one spec, but their episodes {} differ: one is damaged, which "
                        "`etude dataset verify` says, or hosts that need not agree (determinism: physics or none) made "
                        "it twice: delete it from one, or both were imported or merged by an older program, which gave "
                        "them one spec: import or merge them anew",
                        first.string(), second.string(), index));
    }
  return owners;
}

// Of one spec hash, which neither the name nor the split is part of: an episode of the other's name is another one, and
// one that was for validation would be trained on.
Status CheckOneName(const Part& first, const Part& other) {
  const auto differences = internal::DifferencesBesideHash(first.reader.spec(), other.reader.spec());
  if (differences.empty()) return {};
  return Fail(
      Code::kInvalidArgument,
      fmt::format("merge: '{}' and '{}' are of one spec, but not of one {}; where they have no episode in common, "
                  "`etude train --data A B` reads both, each with its own",
                  first.reader.path().string(), other.reader.path().string(),
                  fmt::join(differences, " and not of one ")));
}

// Copies what the first has, then adds what the others have beyond it.
Result<MergeReport> MergeOneSpec(const std::vector<Part>& parts, const Path& out, Leftover leftover,
                                 const EditProgress& progress, const EditFinish& finish) {
  std::vector<Path> datasets;
  for (const Part& part : parts) datasets.push_back(part.reader.path());
  ETUDE_RETURN_IF_ERROR(internal::CheckOneJournal(datasets, "merge"));
  for (const Part& part : parts) ETUDE_RETURN_IF_ERROR(CheckOneName(parts[0], part));
  ETUDE_ASSIGN_OR_RETURN(const auto owners, Owners(parts));
  ETUDE_ASSIGN_OR_RETURN(auto folder, OutputFolder::Create(out, leftover));
  const auto sources = [&](const Part& part) {
    std::set<std::uint64_t> own;
    for (const auto& [index, owner] : owners)
      if (owner == &part) own.insert(index);
    return own;
  };
  // the first one's description is the whole's: that of the one that plans the most, in whatever order they are named
  const auto most = std::ranges::max_element(parts, {}, [](const Part& part) { return part.reader.spec().episodes; });
  std::vector<internal::EpisodeSource> chosen{{most->reader.path(), sources(*most)}};
  for (const Part& part : parts)
    if (&part != &*most) chosen.push_back({part.reader.path(), sources(part)});
  ETUDE_RETURN_IF_ERROR(internal::FillDataset(folder.path(), chosen, progress));
  if (finish) ETUDE_RETURN_IF_ERROR(finish(folder.path()));
  ETUDE_RETURN_IF_ERROR(folder.Commit());
  return MergeReport{owners.size(), false};
}

template <class T>
void Join(std::vector<T>& all, const std::vector<T>& more) {
  for (const T& item : more)
    if (std::find(all.begin(), all.end(), item) == all.end()) all.push_back(item);
}

// Whether the joint spec's draws of camera and world are also the other's.
bool OneWorld(const CampaignSpec& spec, const CampaignSpec& other) {
  return ToJson(spec.camera) == ToJson(other.camera) &&
         ToJson(spec.randomization.world) == ToJson(other.randomization.world);
}

// Of what goes into it: two merges of other episodes are not of one spec, in which a number would mean one episode.
std::uint64_t SeedOf(const std::vector<Part>& parts) {
  Sha256 hash;
  for (const Part& part : parts) {
    hash.Update(fmt::format("{} {}\n", part.reader.spec_sha256(), part.reader.spec().name));
    for (const std::uint64_t index : part.indices) hash.Update(fmt::format("{}\n", index));
  }
  return etude::SeedOf(hash.Finish());
}

Result<CampaignSpec> JointSpec(const std::vector<Part>& parts) {
  CampaignSpec spec = parts[0].reader.spec();
  spec.episodes = 0;
  for (const Part& part : parts) {
    const CampaignSpec& other = part.reader.spec();
    if (other.image_stride != spec.image_stride || other.camera.width != spec.camera.width ||
        other.camera.height != spec.camera.height)
      return Fail(
          Code::kInvalidArgument,
          fmt::format("merge: '{}' has pictures of {}x{} px each {} steps, '{}' of {}x{} px each {}",
                      parts[0].reader.path().string(), spec.camera.width, spec.camera.height, spec.image_stride,
                      part.reader.path().string(), other.camera.width, other.camera.height, other.image_stride));
    Join(spec.robots, other.robots);
    Join(spec.tasks, other.tasks);
    Join(spec.objects, other.objects);
    spec.episodes += part.indices.size();
  }
  // whoever asks where its cameras are is told by the episodes, and not by draws that are one part's alone
  if (!std::ranges::all_of(parts, [&](const Part& part) { return OneWorld(spec, part.reader.spec()); })) {
    auto& world = spec.randomization.world;
    world.camera_position = world.camera_aim = world.camera_roll = world.fovy_deg = 0;
  }
  spec.name = "merged";
  spec.seed = SeedOf(parts);
  spec.task_weights.clear();
  spec.adaptive_sampling = {};
  return spec;
}

// How many merges an episode has gone through, by what it says of where it is from.
int MergesOf(const OrderedJson& from) {
  int count = 1;
  for (const OrderedJson* at = &from; at->is_object() && at->contains("merged_from"); at = &at->at("merged_from"))
    ++count;
  return count;
}

// What it was stays readable; the weights that its campaign had do not hold for its new number.
void MoveTo(const CampaignSpec& spec, const std::string& spec_sha256, std::uint64_t index, Episode& episode) {
  OrderedJson from{{"campaign", episode.campaign}, {"index", episode.index}, {"spec_sha256", episode.spec_sha256}};
  if (const auto sampling = episode.details.find("sampling"); sampling != episode.details.end()) {
    from["sampling"] = *sampling;
    episode.details.erase("sampling");
  }
  if (const auto before = episode.details.find("merged_from"); before != episode.details.end())
    from["merged_from"] = *before;
  // of very many merges, each of the one before, the first ones stay: where it came from, and not every way that it
  // went
  for (constexpr int kMostKept = 8; MergesOf(from) > kMostKept;) {
    OrderedJson earlier = from["merged_from"].value("merged_from", OrderedJson::object());
    from["merged_from"] = std::move(earlier);
  }
  episode.details["merged_from"] = std::move(from);
  episode.campaign = spec.name;
  episode.spec_sha256 = spec_sha256;
  episode.index = index;
}

// Under their new numbers: those that `parts` have in their order. @error kInvalidArgument: a name that the joint spec
// has for something else
Result<FilterKeys> KeysOf(const std::vector<Part>& parts, const CampaignSpec& spec) {
  FilterKeys keys;
  std::uint64_t next = 0;
  for (const Part& part : parts) {
    std::map<std::uint64_t, std::uint64_t> anew;
    for (const std::uint64_t index : part.indices) anew[index] = next++;
    ETUDE_ASSIGN_OR_RETURN(const FilterKeys own, ReadFilterKeys(part.reader.path()));
    for (const auto& [name, chosen] : own) {
      if (const Status fits = internal::CheckKeyName(spec, name); !fits)
        return Fail(fits.error().Wrap(fmt::format("merge '{}'", part.reader.path().string())));
      for (const std::uint64_t index : chosen)
        if (const auto found = anew.find(index); found != anew.end()) keys[name].insert(found->second);
    }
  }
  return keys;
}

Result<MergeReport> MergeDifferent(const std::vector<Part>& parts, const Path& out, Leftover leftover,
                                   const EditProgress& progress) {
  ETUDE_ASSIGN_OR_RETURN(const CampaignSpec spec, JointSpec(parts));
  ETUDE_ASSIGN_OR_RETURN(const FilterKeys keys, KeysOf(parts, spec));
  ETUDE_ASSIGN_OR_RETURN(auto folder, OutputFolder::Create(out, leftover));
  std::uint64_t done = 0;
  {
    ETUDE_ASSIGN_OR_RETURN(auto writer, DatasetWriter::Open(folder.path(), spec));
    const std::string spec_sha256 = SpecHash(spec);
    for (const Part& part : parts)
      for (const std::uint64_t index : part.indices) {
        ETUDE_RETURN_IF_ERROR(internal::CheckNotStopped(done, spec.episodes, folder.path()));
        ETUDE_ASSIGN_OR_RETURN(Episode episode, part.reader.ReadWhole(index));
        MoveTo(spec, spec_sha256, done, episode);
        ETUDE_RETURN_IF_ERROR(writer.Commit(episode));
        ++done;
        if (progress) progress(done, spec.episodes);
      }
    if (!keys.empty()) ETUDE_RETURN_IF_ERROR(internal::WriteFilterKeys(folder.path(), keys));
    ETUDE_RETURN_IF_ERROR(writer.WriteMaster());
  }
  ETUDE_RETURN_IF_ERROR(MarkDerived(folder.path()));
  ETUDE_RETURN_IF_ERROR(folder.Commit());
  return MergeReport{done, true};
}

}  // namespace

Result<MergeReport> MergeDatasets(const std::vector<Path>& datasets, const Path& out, Leftover leftover,
                                  const EditProgress& progress, const EditFinish& finish) {
  ETUDE_ASSIGN_OR_RETURN(const auto parts, OpenParts(datasets));
  return OfOneSpec(parts) ? MergeOneSpec(parts, out, leftover, progress, finish)
                          : MergeDifferent(parts, out, leftover, progress);
}

namespace internal {

Status CheckOneJournal(const std::vector<Path>& datasets, std::string_view command) {
  ETUDE_ASSIGN_OR_RETURN(const auto journal, ReadTextFileIfThere(datasets.front() / kSampling));
  for (const Path& dataset : datasets) {
    ETUDE_ASSIGN_OR_RETURN(const auto other, ReadTextFileIfThere(dataset / kSampling));
    if (other.value_or("") != journal.value_or(""))
      return Fail(Code::kInvalidArgument,
                  fmt::format("{}: '{}' and '{}' have different sampling journals ({}): an index means another episode "
                              "in each",
                              command, datasets.front().string(), dataset.string(), kSampling));
  }
  return {};
}

}  // namespace internal

}  // namespace etude::store

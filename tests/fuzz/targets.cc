// SPDX-License-Identifier: Apache-2.0
#include "tests/fuzz/targets.h"

#include <algorithm>
#include <cstring>

#include "services/bus/assembly.h"
#include "services/bus/serialized.h"
#include "services/core/check.h"
#include "services/core/config.h"
#include "services/core/hash.h"
#include "services/episode/attempt_times.h"
#include "services/episode/bounded_json.h"
#include "services/episode/codec.h"
#include "services/episode/frame_cursor.h"
#include "services/spec/campaign_spec.h"
#include "services/spec/object_names.h"
#include "services/spec/sampling_weights.h"
#include "services/spec/task_spec.h"
#include "services/store/episode_file.h"
#include "services/store/safetensors.h"
#include "tests/support/synthetic_episode.h"

namespace etude::fuzz {
namespace {

using Input = std::span<const std::uint8_t>;

std::string TextOf(Input bytes) { return {bytes.begin(), bytes.end()}; }
Bytes BytesOf(const std::string& text) { return {text.begin(), text.end()}; }

void EpisodeCodec(Input bytes) {
  const auto episode = DecodeEpisode(bytes);
  // what a collector takes: the same episode, and its hash is that of the bytes
  if (const auto view = ViewEpisode(bytes)) {
    ETUDE_CHECK(episode.has_value(), "an episode that can be viewed and not decoded");
    ETUDE_CHECK(EpisodeSha256(view->episode, view->streams) == Sha256Hex(bytes), "the hash of other bytes");
  }
  if (!episode) return;
  // what was taken can be sent on
  ETUDE_CHECK(DecodeEpisode(EncodeEpisode(*episode)).has_value(), "an episode that cannot be read again");
}

// A damaged file is recognised by its seal; behind it stands the parser, which is asked here with a seal that fits.
void EpisodeFile(Input bytes) {
  (void)store::internal::DecodeEpisodeFile(bytes);
  Bytes sealed(bytes.begin(), bytes.end());
  store::internal::AppendSeal(sealed);
  auto file = store::internal::DecodeEpisodeFile(sealed);
  if (!file) return;
  const Episode episode = store::internal::WithStreams(std::move(*file), sealed);
  (void)store::internal::CheckStreams(episode, StreamsOf(episode));
  for (std::size_t i = 0; i < episode.cameras.size(); ++i) {
    if (episode.cameras[i].layout().block_bytes() > 1 << 20) continue;
    FrameCursor frames(episode, i);
    for (std::size_t k = 0; k < frames.size(); ++k) (void)frames.Frame(k);
  }
}

void Tensors(Input bytes) {
  const auto content = store::DecodeSafetensors(bytes);
  if (!content) return;
  for (const auto& [name, tensor] : content->tensors)
    ETUDE_CHECK(tensor.data.size() <= bytes.size(), "tensor {} is larger than its file", name);
}

void Cdr(Input bytes) {
  bus::ManifestView manifest;
  bus::ChunkView chunk;
  bus::PublishedChunkView published;
  const auto within = [&](const auto& view) {
    const auto* at = reinterpret_cast<const std::uint8_t*>(view.data());
    ETUDE_CHECK(view.empty() || (at >= bytes.data() && at + view.size() <= bytes.data() + bytes.size()));
  };
  if (bus::Parse(bytes, manifest)) {
    within(manifest.data);
    within(manifest.meta_json);
    within(manifest.sha256);
  }
  if (bus::Parse(bytes, chunk)) within(chunk.data);
  if (bus::Parse(bytes, published)) within(published.data);
}

// A shape, then chunks: a byte says which, the next how many of the bytes that follow.
void ManifestAssembly(Input bytes) {
  std::uint32_t shape[2] = {};
  if (bytes.size() < sizeof shape) return;
  std::memcpy(shape, bytes.data(), sizeof shape);
  bytes = bytes.subspan(sizeof shape);
  const std::uint64_t size = shape[0] % (1u << 20);
  const std::uint32_t chunk = shape[1];
  if (chunk == 0 || !bus::ShapeIsSound(size, chunk, bus::ChunkCount(size, chunk))) return;
  bus::Assembly assembly(size, chunk);
  while (bytes.size() >= 2 && !assembly.complete()) {
    const std::size_t length = std::min<std::size_t>(bytes[1], bytes.size() - 2);
    (void)assembly.Add(bytes[0], bytes.subspan(2, length));
    bytes = bytes.subspan(2 + length);
  }
  ETUDE_CHECK(assembly.Missing(16).size() <= 16);
  if (assembly.complete()) ETUDE_CHECK(assembly.TakeBytes().size() == size);
}

void JsonOfTheBus(Input bytes) {
  const auto json = ParseBoundedJson(TextOf(bytes));
  if (!json) return;
  const auto spec = FromJson<CampaignSpec>(*json, "fuzz");
  if (spec) (void)spec->Validate();
  // what collectors hear of a run's errors, and workers of weights
  static const CampaignSpec followed = [] {
    CampaignSpec made = SyntheticSpec();
    made.adaptive_sampling.share = 0.5;
    return made;
  }();
  (void)ParseWeights(TextOf(bytes), followed);
  (void)ParseErrorCells(TextOf(bytes), followed);
  (void)TimesOf(*json);
}

void YamlSpecs(Input bytes) {
  const auto json = ParseYaml(TextOf(bytes), "fuzz");
  if (!json || !json->is_object()) return;
  const auto spec = FromJson<CampaignSpec>(*json, "fuzz");
  if (spec) (void)spec->Validate();
  (void)ParseTaskSpec(*json, "fuzz");
}

Bytes CdrChunk() {
  Bytes cdr{0, 7, 0, 0};
  const auto number = [&](std::uint64_t value, int size) {
    for (int i = 0; i < size; ++i) cdr.push_back(static_cast<std::uint8_t>(value >> (8 * i)));
  };
  number(5, 8);  // id
  number(2, 4);  // index
  for (int text = 0; text < 2; ++text) {
    number(4, 4);
    for (const char c : {'a', 'b', 'c', '\0'}) cdr.push_back(static_cast<std::uint8_t>(c));
  }
  number(8, 4);
  number(0x0102030405060708, 8);
  return cdr;
}

Bytes Chunks() {
  Bytes bytes{6, 0, 0, 0, 4, 0, 0, 0};  // 6 bytes in chunks of 4
  for (const int byte : {1, 2, 9, 9, 0, 4, 1, 2, 3, 4}) bytes.push_back(static_cast<std::uint8_t>(byte));
  return bytes;
}

SamplingWeights ExampleWeights(const CampaignSpec& spec) {
  SamplingWeights weights;
  for (const auto& task : spec.tasks) weights.tasks[task] = 1;
  for (const auto& object : spec.objects) weights.objects[ObjectNoun(object)] = 2;
  weights.places.assign(kPlaces, 0.5);
  return weights;
}

std::vector<Target> Make() {
  const CampaignSpec spec = SyntheticSpec();
  const Episode episode = MakeSyntheticEpisode(spec, 3, 6);
  const Episode whole = Recut(episode, {1, 0}), cut = Recut(episode, {1, 20});
  const auto file = store::internal::EncodeEpisodeFile(episode), bands = store::internal::EncodeEpisodeFile(cut);
  ETUDE_CHECK(file.has_value() && bands.has_value());
  auto by_library = store::internal::EncodeByLibrary(episode);
  ETUDE_CHECK(by_library.has_value());
  store::internal::AppendSeal(*by_library);
  store::Safetensors tensors;
  tensors.metadata["a"] = "b";
  tensors.tensors["x"] = {store::DType::kF32, {2, 2}, Bytes(16, 1)};
  tensors.tensors["y"] = {store::DType::kU8, {3}, Bytes(3, 2)};
  return {{"episode_codec", EpisodeCodec, {EncodeEpisode(episode), EncodeEpisode(whole), EncodeEpisode(cut)}},
          {"episode_file", EpisodeFile, {*file, *bands, *by_library}},
          {"safetensors", Tensors, {store::EncodeSafetensors(tensors)}},
          {"cdr", Cdr, {CdrChunk()}},
          {"manifest_assembly", ManifestAssembly, {Chunks()}},
          {"bus_json", JsonOfTheBus, {BytesOf(ToJson(spec).dump()), BytesOf(WeightsText(ExampleWeights(spec)))}},
          {"yaml", YamlSpecs, {BytesOf(ToYaml(ToJson(spec)))}}};
}

}  // namespace

const std::vector<Target>& Targets() {
  static const std::vector<Target> targets = Make();
  return targets;
}

}  // namespace etude::fuzz

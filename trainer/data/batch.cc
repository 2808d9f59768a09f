// SPDX-License-Identifier: Apache-2.0
#include "trainer/data/batch.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <span>

#include "services/core/rng.h"
#include "services/episode/viewpoint.h"
#include "services/language/sentence.h"
#include "trainer/data/cutout.h"

namespace etude::data {

void DataConfig::Check(std::vector<std::string>& errors) const {
  const auto require = [&](bool good, std::string message) {
    if (!good) errors.push_back("data." + std::move(message));
  };
  require(batch >= 1 && batch <= 4096, fmt::format("batch: {} not in 1..4096", batch));
  require(sentences >= 1 && sentences <= 64, fmt::format("sentences: {} not in 1..64", sentences));
  require(sentence_variants >= 1, fmt::format("sentence_variants: {} must be >= 1", sentence_variants));
  for (const double share : {strange, masked})
    require(share >= 0 && share <= 1, fmt::format("strange, masked: {} not in 0..1", share));
  require(varied >= 0 && noisy >= 0 && varied + noisy <= 1, "varied, noisy: fractions with a sum of at most 1");
  require(clauses >= 0 && clauses <= 1, fmt::format("clauses: {} not in 0..1", clauses));
  require(jitter >= 0 && jitter <= 64, fmt::format("jitter: {} not in 0..64", jitter));
  for (double x : {brightness, contrast, colour})
    require(x >= 0 && x < 1, fmt::format("brightness, contrast, colour: {} not in 0..1", x));
  require(rest > 0 && rest <= 1, fmt::format("rest: {} not above 0 and at most 1", rest));
  require(cutout >= 0 && cutout < 1, fmt::format("cutout: {} not in 0..1", cutout));
  require(cache_mb >= 0, "cache_mb: must be >= 0");
  require(threads >= 1 && threads <= 256, fmt::format("threads: {} not in 1..256", threads));
  require(prefetch >= 1 && prefetch <= 1024, fmt::format("prefetch: {} not in 1..1024", prefetch));
  require(min_episodes >= 1, "min_episodes: must be >= 1");
  require(min_valid >= 1, "min_valid: must be >= 1");
  require(refresh_s > 0, "refresh_s: must be > 0");
}

// how one picture is cut and coloured
struct BatchMaker::View {
  int u = 0, v = 0;  // of the crop in the camera's picture, px
  bool coloured = false;
  std::array<std::array<std::uint8_t, 256>, 3> channel{};  // colour maps
};

namespace {

// the crop with the jitter's margin, inside the picture
Region Margin(const Region& crop, int jitter, int picture_width, int picture_height) {
  const int u = std::max(0, std::min(crop.u, crop.u - jitter)), v = std::max(0, std::min(crop.v, crop.v - jitter));
  const int right = std::max(crop.u + crop.width, std::min(picture_width, crop.u + crop.width + jitter));
  const int bottom = std::max(crop.v + crop.height, std::min(picture_height, crop.v + crop.height + jitter));
  return {u, v, right - u, bottom - v};
}

language::Style DrawStyle(const DataConfig& config, Rng& rng) {
  const double draw = rng.Uniform();
  if (draw < config.noisy) return language::Style::kNoisy;
  return draw < config.noisy + config.varied ? language::Style::kVaried : language::Style::kTemplate;
}

// sentences of a batch, each distinct one once
class SentenceBook {
 public:
  SentenceBook(const language::Grammar& grammar, const DataConfig& config, std::uint64_t seed, Augment augment)
      : grammar_(grammar), config_(config), seed_(seed), augment_(augment) {}

  std::int64_t Find(const language::Command& command, std::uint64_t variant, std::vector<std::string>& sentences) {
    const auto key =
        fmt::format("{}/{}/{}/{}/{}", command.task, command.target, command.reference, command.obstacle, variant);
    if (const auto it = by_key_.find(key); it != by_key_.end()) return it->second;
    Rng rng(MixSeed({seed_}, key));
    const auto style = augment_ == Augment::kYes ? DrawStyle(config_, rng) : language::Style::kTemplate;
    std::string sentence = grammar_.Sample(command, style, rng, config_.masked);
    if (augment_ == Augment::kYes && config_.strange > 0 && rng.Bernoulli(config_.strange))
      language::AddStrangeWord(sentence, rng);
    const auto [it, fresh] = by_text_.emplace(sentence, static_cast<std::int64_t>(sentences.size()));
    if (fresh) sentences.push_back(std::move(sentence));
    return by_key_[key] = it->second;
  }

 private:
  const language::Grammar& grammar_;
  const DataConfig& config_;
  std::uint64_t seed_;
  Augment augment_;
  std::map<std::string, std::int64_t> by_key_, by_text_;
};

void SetShape(LabelArray& label, std::vector<std::int64_t> shape, std::vector<std::int64_t> valid_shape) {
  std::size_t size = 1, valid_size = 1;
  for (auto n : shape) size *= static_cast<std::size_t>(n);
  for (auto n : valid_shape) valid_size *= static_cast<std::size_t>(n);
  label.shape = std::move(shape);
  label.valid_shape = std::move(valid_shape);
  label.values.assign(size, 0.0f);
  label.valid.assign(valid_size, 0);
}

}  // namespace

BatchMaker::BatchMaker(const DataConfig& config, BatchContent content, std::shared_ptr<const language::Grammar> grammar)
    : config_(config),
      content_(std::move(content)),
      grammar_(std::move(grammar)),
      cache_(std::make_unique<FrameCache>(
          Margin(content_.crop, config.jitter, content_.picture_width, content_.picture_height),
          static_cast<std::size_t>(config.cache_mb) << 20)) {}

BatchMaker::View BatchMaker::DrawView(const Sample& sample, Augment augment) const {
  View view{content_.crop.u, content_.crop.v};
  if (augment == Augment::kNo) return view;
  Rng rng(MixSeed({sample.seed}, "view"));
  const Region& region = cache_->region();
  const auto place = [&](int low, int high) {
    return low + static_cast<int>(rng.Below(static_cast<std::uint64_t>(high - low + 1)));
  };
  view.u = place(region.u, region.u + region.width - content_.crop.width);
  view.v = place(region.v, region.v + region.height - content_.crop.height);

  const double bias = 255 * rng.Uniform(-config_.brightness, config_.brightness);
  const double gain = 1 + rng.Uniform(-config_.contrast, config_.contrast);
  for (auto& map : view.channel) {
    const double own = gain * (1 + rng.Uniform(-config_.colour, config_.colour));
    for (int x = 0; x < 256; ++x)
      map[static_cast<std::size_t>(x)] =
          static_cast<std::uint8_t>(std::clamp(std::lround(own * (x - 128) + 128 + bias), 0l, 255l));
  }
  view.coloured = true;
  return view;
}

void BatchMaker::CopyPixels(const std::uint8_t* region, const View& view, std::uint8_t* out) const {
  const Region& whole = cache_->region();
  const std::size_t row = static_cast<std::size_t>(content_.crop.width) * 3;
  for (int y = 0; y < content_.crop.height; ++y) {
    const std::uint8_t* in =
        region + (static_cast<std::size_t>(view.v - whole.v + y) * whole.width + (view.u - whole.u)) * 3;
    std::uint8_t* to = out + row * y;
    if (!view.coloured) {
      std::memcpy(to, in, row);
      continue;
    }
    for (std::size_t x = 0; x < row; x += 3) {
      to[x] = view.channel[0][in[x]];
      to[x + 1] = view.channel[1][in[x + 1]];
      to[x + 2] = view.channel[2][in[x + 2]];
    }
  }
}

void BatchMaker::Allocate(std::size_t size, int joints, Batch& batch) const {
  const auto B = static_cast<std::int64_t>(size), S = static_cast<std::int64_t>(config_.sentences);
  batch.size = static_cast<int>(size);
  batch.sentences_each = config_.sentences;
  batch.height = content_.crop.height;
  batch.width = content_.crop.width;
  batch.joints_each = joints;
  batch.images.resize(size * content_.crop.bytes());
  batch.crop_origin.assign(size * 2, 0);
  batch.viewpoint.assign(size * kViewpointSize, 0);
  batch.joints.assign(size * static_cast<std::size_t>(joints), 0);
  batch.sentences.clear();
  batch.sentence_index.assign(static_cast<std::size_t>(B * S), 0);
  batch.frames.clear();
  for (const LabelColumn& column : content_.labels) {
    std::vector<std::int64_t> shape{B, column.entity.per_sentence() ? S : 1}, valid = shape;
    if (column.entity.is_set()) shape.push_back(kMaxOthers), valid.push_back(kMaxOthers);
    if (column.rule->label_parts() > 1) valid.push_back(column.rule->label_parts());
    const auto own = column.rule->label_shape();
    shape.insert(shape.end(), own.begin(), own.end());
    SetShape(batch.labels[column.name], std::move(shape), std::move(valid));
  }
}

void BatchMaker::FillLabels(const LabelColumn& column, const Episode& episode, int step, std::size_t b,
                            const View& view, const std::vector<language::Command>& commands, LabelArray& label) const {
  const std::size_t slots = column.entity.is_set() ? kMaxOthers : 1;
  const std::size_t rows = column.entity.per_sentence() ? commands.size() : 1;
  const auto parts = static_cast<std::size_t>(column.rule->label_parts());
  const std::size_t all = label.valid.size() / parts;  // labels in the array
  const std::size_t size = label.values.size() / all;
  const Region seen{view.u, view.v, content_.crop.width, content_.crop.height};
  for (std::size_t s = 0; s < rows; ++s) {
    const LabelContext context{episode, step, commands[s], content_.classes, seen, content_.known_tasks};
    const auto states = StatesOf(column.entity, context);
    for (std::size_t k = 0; k < std::min(slots, states.size()); ++k) {
      const std::size_t row = (b * rows + s) * slots + k;
      column.rule->FillLabel(context, states[k], std::span(label.values).subspan(row * size, size),
                             std::span(label.valid).subspan(row * parts, parts));
    }
  }
}

std::vector<language::Command> BatchMaker::CommandsOf(const Episode& episode, const Sample& sample,
                                                      Augment augment) const {
  auto commands = DrawCommands(episode, content_.tasks, config_.sentences, sample.seed);
  if (augment == Augment::kYes) AddClauses(episode, grammar_->tasks(), config_.clauses, sample.seed, commands);
  return commands;
}

Status BatchMaker::Make(const Snapshot& snapshot, const std::vector<Sample>& samples, std::uint64_t step,
                        Augment augment, FrameScratch& scratch, Batch& batch, std::size_t* bad) const {
  if (samples.empty()) return Fail(Code::kNotFound, "make a batch: the split has no frames");
  const Episode& first = snapshot.episodes()[samples[0].frame.episode]->episode();
  Allocate(samples.size(), first.joint_pos.columns + first.gripper_qpos.columns, batch);
  batch.step = step;
  SentenceBook book(*grammar_, config_, samples[0].seed, augment);
  for (std::size_t b = 0; b < samples.size(); ++b) {
    if (bad) *bad = b;
    const EpisodeEntry& entry = *snapshot.episodes()[samples[b].frame.episode];
    const Episode& episode = entry.episode();
    const int row = entry.StepOf(samples[b].frame.frame);
    const View view = DrawView(samples[b], augment);
    ETUDE_ASSIGN_OR_RETURN(const std::uint8_t* region, cache_->Get(entry, samples[b].frame.frame, scratch));
    const std::span picture = std::span(batch.images).subspan(b * content_.crop.bytes(), content_.crop.bytes());
    CopyPixels(region, view, picture.data());
    if (augment == Augment::kYes && config_.cutout > 0) {
      Rng own(MixSeed({samples[b].seed}, "cutout"));
      CutOut(config_.cutout, content_.crop.width, content_.crop.height, own, picture);
    }
    batch.crop_origin[2 * b] = static_cast<float>(view.u);
    batch.crop_origin[2 * b + 1] = static_cast<float>(view.v);
    std::ranges::copy(ViewpointOf(episode.cameras.at(0).camera),
                      batch.viewpoint.begin() + static_cast<std::ptrdiff_t>(b * kViewpointSize));

    const auto arm = episode.joint_pos.row(row), gripper = episode.gripper_qpos.row(row);
    if (static_cast<int>(arm.size() + gripper.size()) != batch.joints_each)
      return Fail(Code::kCorrupt, fmt::format("'{}': {} joints, others have {}", entry.record.path.string(),
                                              arm.size() + gripper.size(), batch.joints_each));
    auto joints = batch.joints.begin() + static_cast<std::ptrdiff_t>(b) * batch.joints_each;
    std::copy(gripper.begin(), gripper.end(), std::copy(arm.begin(), arm.end(), joints));

    const auto commands = CommandsOf(episode, samples[b], augment);
    Rng rng(MixSeed({samples[b].seed}, "variants"));
    for (std::size_t s = 0; s < commands.size(); ++s)
      batch.sentence_index[b * commands.size() + s] =
          book.Find(commands[s], rng.Below(static_cast<std::uint64_t>(config_.sentence_variants)), batch.sentences);
    for (const LabelColumn& column : content_.labels)
      FillLabels(column, episode, row, b, view, commands, batch.labels.at(column.name));
    batch.frames.push_back(samples[b].frame);
  }
  return {};
}

Status MakeReadable(const BatchMaker& maker, const Snapshot& snapshot, std::uint64_t step, Augment augment,
                    std::vector<Sample>& samples, FrameScratch& scratch, Batch& batch,
                    const std::function<void(const Error&)>& unreadable) {
  while (true) {
    std::size_t bad = 0;
    Status made = maker.Make(snapshot, samples, step, augment, scratch, batch, &bad);
    if (made || samples.empty() || made.error().code == Code::kInvalidArgument) return made;
    if (unreadable) unreadable(made.error());
    samples.erase(samples.begin() + static_cast<std::ptrdiff_t>(bad));
    if (samples.empty()) return made;
  }
}

void KeepDemonstrated(Batch& batch) {
  const auto B = static_cast<std::size_t>(batch.size), S = static_cast<std::size_t>(batch.sentences_each);
  if (S == 1) return;
  const auto first_of_each = [&](auto& values) {
    const std::size_t picture = values.size() / B, sentence = picture / S;
    for (std::size_t b = 1; b < B; ++b)
      std::copy_n(values.begin() + static_cast<std::ptrdiff_t>(b * picture), sentence,
                  values.begin() + static_cast<std::ptrdiff_t>(b * sentence));
    values.resize(B * sentence);
  };
  first_of_each(batch.sentence_index);
  for (auto& [name, label] : batch.labels) {
    if (label.shape[1] != batch.sentences_each) continue;
    label.shape[1] = label.valid_shape[1] = 1;
    first_of_each(label.values);
    first_of_each(label.valid);
  }
  // no more text to encode than is asked
  std::vector<std::string> asked;
  std::map<std::int64_t, std::int64_t> places;
  for (auto& index : batch.sentence_index) {
    const auto [place, is_new] = places.try_emplace(index, std::ssize(asked));
    if (is_new) asked.push_back(batch.sentences[static_cast<std::size_t>(index)]);
    index = place->second;
  }
  batch.sentences = std::move(asked);
  batch.sentences_each = 1;
}

}  // namespace etude::data

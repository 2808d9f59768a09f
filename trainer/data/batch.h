// SPDX-License-Identifier: Apache-2.0
// One batch as plain arrays, and how it is made from samples.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "services/language/grammar.h"
#include "trainer/data/frame_cache.h"
#include "trainer/data/labels.h"
#include "trainer/data/sampler.h"

namespace etude::data {

struct DataConfig {
  int batch = 64;             ///< pictures a step
  int sentences = 6;          ///< S: commands asked about each picture; 1 switches relabelling off
  int sentence_variants = 4;  ///< wordings of one command within a batch (each is encoded once)
  double varied = 0.4;        ///< fraction of sentences with synonyms and free word order
  double noisy = 0.3;         ///< fraction that has typing errors too; the rest are plain templates
  double strange = 0;         ///< fraction with a word of random letters among theirs: unheard words are passed over
  double masked = 0;          ///< of noun phrases, with a word of random letters for one that the other makes up for
  double clauses = 0;         ///< fraction of relabelled sentences with something to keep off or a second object
  double rest = 1;            ///< share of the frames at rest, at a demonstration's end, that are taken
  int jitter = 4;             ///< +- px, random place of the crop
  double brightness = 0.06;   ///< +- fraction of 255
  double contrast = 0.08;     ///< +- fraction
  double colour = 0.04;       ///< +- fraction, of each channel on its own
  double cutout = 0;          ///< up to this fraction of a picture under grey squares
  int cache_mb = 6000;        ///< decoded crops kept in memory
  int threads = 1;            ///< that make batches
  int prefetch = 4;           ///< batches made ahead
  int min_episodes = 24;      ///< training waits for this many when the dataset still grows
  int min_valid = 4;          ///< and for this many of the validation split; those that are there then are the set
  double refresh_s = 5;       ///< how often a growing dataset is looked at

  void Visit(auto& v) {
    v("batch", batch, "-", "pictures a step");
    v("sentences", sentences, "-", "commands asked about each picture; 1: no relabelling");
    v("sentence_variants", sentence_variants, "-", "wordings of one command within a batch");
    v("varied", varied, "-", "share of sentences with synonyms and free word order");
    v("noisy", noisy, "-", "share that has typing errors too");
    v("strange", strange, "-",
      "share with a word of random letters among theirs, so that unheard words are passed over");
    v("masked", masked, "-",
      "share of noun phrases with random letters in place of a word that they can do without: 'push xqv cube'");
    v("clauses", clauses, "-", "share of relabelled sentences that also say what to keep off, or name a second object");
    v("rest", rest, "-",
      "share of the frames of a last stage `hold`, in which the hand rests, that are taken: they look like the "
      "middle of a demonstration that began nearer");
    v("jitter", jitter, "px", "the crop is displaced by up to this much, either way");
    v("brightness", brightness, "-", "of 255, changed by up to this share");
    v("contrast", contrast, "-", "changed by up to this share");
    v("colour", colour, "-", "of each channel on its own, changed by up to this share");
    v("cutout", cutout, "-",
      "up to this share of a picture lies under grey squares of 8 x 8 px, so that less is enough");
    v("cache_mb", cache_mb, "MB", "decoded crops kept in memory");
    v("threads", threads, "-", "that make batches");
    v("prefetch", prefetch, "-", "batches made ahead");
    v("min_episodes", min_episodes, "-", "episodes that training waits for when the dataset still grows");
    v("min_valid", min_valid, "-", "validation episodes that training waits for when the dataset still grows");
    v("refresh_s", refresh_s, "s", "how often a growing dataset is looked at");
  }

  /// Appends every problem to `errors`.
  void Check(std::vector<std::string>& errors) const;
};

/// One label of all pictures: (B, S | 1, [kMaxOthers], ...) as labels.h says.
struct LabelArray {
  std::vector<std::int64_t> shape;
  std::vector<float> values;
  std::vector<std::int64_t> valid_shape;
  std::vector<std::uint8_t> valid;
};

/// B pictures with S sentences each. Labels by the names of their columns.
struct Batch {
  std::uint64_t step = 0;
  int size = 0, sentences_each = 0, height = 0, width = 0, joints_each = 0;
  std::vector<std::uint8_t> images;          ///< (B, h, w, 3)
  std::vector<float> crop_origin;            ///< (B, 2) px
  std::vector<float> viewpoint;              ///< (B, kViewpointSize) of each picture's camera
  std::vector<float> joints;                 ///< (B, J)
  std::vector<std::string> sentences;        ///< D distinct ones
  std::vector<std::int64_t> sentence_index;  ///< (B, S)
  std::map<std::string, LabelArray> labels;
  std::vector<FrameRef> frames;  ///< (B) where each picture comes from
};

/// Leaves each picture the command that its episode demonstrates (s = 0): without relabelling.
void KeepDemonstrated(Batch& batch);

enum class Augment { kNo, kYes };

/// What the policy that is trained sees and is told.
struct BatchContent {
  Region crop;                       ///< of the camera's picture
  int picture_width = 0;             ///< px, of the camera; the jitter is cut to what fits
  int picture_height = 0;            ///< px
  std::vector<std::string> tasks;    ///< that relabelled sentences name
  std::vector<std::string> classes;  ///< nouns that class heads know (ObjectNoun)
  std::vector<LabelColumn> labels;
  std::vector<std::string> known_tasks{};  ///< that task heads know
};

/// Makes batches. Const methods are thread-safe.
class BatchMaker {
 public:
  BatchMaker(const DataConfig& config, BatchContent content, std::shared_ptr<const language::Grammar> grammar);

  /// Fills `batch` (its buffers are used again) from `samples` of `snapshot`. With kNo the crop
  /// stands still, colours are as rendered and sentences are plain templates.
  /// @error of reading a frame; `bad` (if given) gets the number of the sample.
  Status Make(const Snapshot& snapshot, const std::vector<Sample>& samples, std::uint64_t step, Augment augment,
              FrameScratch& scratch, Batch& batch, std::size_t* bad = nullptr) const;

  /// What the sentences of a sample ask for, the demonstrated command first: those that Make uses.
  std::vector<language::Command> CommandsOf(const Episode& episode, const Sample& sample, Augment augment) const;

  const FrameCache& cache() const { return *cache_; }

 private:
  struct View;
  View DrawView(const Sample& sample, Augment augment) const;
  void CopyPixels(const std::uint8_t* region, const View& view, std::uint8_t* out) const;
  void FillLabels(const LabelColumn& column, const Episode& episode, int step, std::size_t b, const View& view,
                  const std::vector<language::Command>& commands, LabelArray& label) const;
  void Allocate(std::size_t size, int joints, Batch& batch) const;

  DataConfig config_;
  BatchContent content_;
  std::shared_ptr<const language::Grammar> grammar_;
  std::unique_ptr<FrameCache> cache_;
};

/// Makes the batch of those of `samples` that can be read, which are all that is left of them: a file that went away
/// ends no training. @param unreadable  is told why, once for each
/// @error of the last one where none is left; kInvalidArgument: of BatchMaker::Make, and some are left
Status MakeReadable(const BatchMaker& maker, const Snapshot& snapshot, std::uint64_t step, Augment augment,
                    std::vector<Sample>& samples, FrameScratch& scratch, Batch& batch,
                    const std::function<void(const Error&)>& unreadable = nullptr);

}  // namespace etude::data

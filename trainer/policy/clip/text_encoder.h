// SPDX-License-Identifier: Apache-2.0
// A folder of CLIP's files, open: a sentence becomes what CLIP says that it means.
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <future>
#include <list>
#include <memory>
#include <string>
#include <unordered_map>
#include <vector>

#include "services/core/file.h"
#include "services/core/thread_annotations.h"
#include "services/language/byte_pair_tokenizer.h"
#include "trainer/policy/clip/tower.h"

namespace etude::clip {

/// Hugging Face's files of a CLIP model: model.safetensors (tensors of the picture's tower are passed over),
/// vocab.json, merges.txt, and config.json where it is there.
///
/// A sentence is embedded once and then remembered, those that were asked for last; threads that ask for
/// different ones compute side by side. Each is computed alone, so that what it becomes depends on nothing but it.
/// Every function may be called from several threads at once.
class TextEncoder {
 public:
  static constexpr std::size_t kRemembered = 131072;  ///< sentences, 2 kB each with ViT-B/32
  static constexpr std::size_t kMostBytes = 1024;     ///< of a sentence

  /// @param sha256      of the content that is wanted; "": any
  /// @param remembered  sentences at most, >= 1
  /// @error kNotFound: a file that is missing; kCorrupt: what is wrong in which; kInvalidArgument: other content
  static Result<std::shared_ptr<TextEncoder>> Open(const Path& folder, const std::string& sha256 = "",
                                                   std::size_t remembered = kRemembered);

  /// What `(sha256sum merges.txt model.safetensors vocab.json; echo heads 8) | sha256sum` says in the folder of a
  /// tower with 8 heads.
  const std::string& sha256() const { return sha256_; }
  /// Numbers of an embedding.
  std::int64_t width() const { return tower_.sizes().output; }

  /// @error kInvalidArgument: the sentence has more tokens than the tower has positions, or more than kMostBytes
  Status Check(const std::string& sentence) const;
  /// Of sentences that Check accepts; c10::Error with its words otherwise.
  /// @returns (D, width) float32, without gradient
  torch::Tensor Embed(const std::vector<std::string>& sentences);
  /// Sentences computed so far, those that were not remembered.
  std::uint64_t computed() const ETUDE_EXCLUDES(mutex_);

 private:
  using Embedding = std::shared_future<torch::Tensor>;
  struct Remembered {
    Embedding embedding;
    std::list<std::string>::iterator place;  ///< in recent_
  };

  struct Parts;
  TextEncoder(Parts parts, std::size_t remembered);
  static Result<Parts> OpenParts(const Path& folder, const std::string& wanted);
  Result<std::vector<std::int64_t>> TokensOf(const std::string& sentence) const;
  torch::Tensor Compute(const std::string& sentence) const;
  Embedding Find(const std::string& sentence) ETUDE_EXCLUDES(mutex_);
  Embedding Remember(const std::string& sentence, Embedding embedding) ETUDE_REQUIRES(mutex_);
  void Forget(const std::string& sentence) ETUDE_REQUIRES(mutex_);

  const language::BytePairTokenizer tokenizer_;
  const Tower tower_;
  const std::string sha256_;
  const std::size_t most_remembered_;
  mutable Mutex mutex_;
  std::unordered_map<std::string, Remembered> remembered_ ETUDE_GUARDED_BY(mutex_);
  std::list<std::string> recent_ ETUDE_GUARDED_BY(mutex_);  ///< the last one that was asked for first
  std::uint64_t computed_ ETUDE_GUARDED_BY(mutex_) = 0;
};

/// The folders on this machine, each opened once and kept for those who ask again. Thread-safe.
class Folders {
 public:
  /// @param instead  in place of whatever folder is asked for: a policy names the one of the machine that it was
  ///                 trained on; "": the one that is asked for
  explicit Folders(std::string instead = "") : instead_(std::move(instead)) {}
  /// @error as TextEncoder::Open
  Result<std::shared_ptr<TextEncoder>> Open(const std::string& folder, const std::string& sha256)
      ETUDE_EXCLUDES(mutex_);

 private:
  const std::string instead_;
  Mutex mutex_;
  std::unordered_map<std::string, std::shared_ptr<TextEncoder>> open_ ETUDE_GUARDED_BY(mutex_);
};

}  // namespace etude::clip

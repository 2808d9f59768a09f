// SPDX-License-Identifier: Apache-2.0
// A dataset as one HDF5 file without links, as robomimic's own datasets are: for whoever wants a single file to copy.
// (The dataset's own dataset.hdf5 opens in robomimic too, as long as the episodes lie beside it.)
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "services/core/output_folder.h"
#include "services/store/dataset.h"

namespace etude::store {

struct PlainFileOptions {
  std::vector<std::uint64_t> indices;  ///< of the episodes; none: all
  Leftover leftover = Leftover::kRefuse;
  std::function<void(std::uint64_t done, std::uint64_t total)> progress;  ///< may be empty
};

struct PlainFileReport {
  std::uint64_t episodes = 0, samples = 0, sentences = 0;
  Path train_data;  ///< beside the file
};

/// Writes OUT, and beside it OUT.train_data.json: what robomimic's config wants under train.data, an entry a sentence
/// with its filter key. In OUT: /data/demo_<index> of every episode, bytes of pictures as they are; /mask with the
/// dataset's filter keys (splits, tasks, own ones) and lang_<n>, the training split's episodes of one sentence, whose
/// text is in the attribute `lang` of that mask. Episode by episode; each one's seal and pictures are checked, and it
/// is encoded anew, in this program's schema. OUT appears when all of it is durable, then its .json. A stop request
/// ends it before the next episode.
/// @error kInvalidArgument: OUT or its .json is there, or what an interrupted command left; kNotFound: no dataset or no
/// episode; kExhausted: stopped; kCorrupt: an episode; kUnavailable
Result<PlainFileReport> WritePlainFile(const Path& dataset, const Path& out, const PlainFileOptions& options);

}  // namespace etude::store

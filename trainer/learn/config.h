// SPDX-License-Identifier: Apache-2.0
// Everything a training run is made of, as one file (trainer/experiments/*.yaml).
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "services/core/config.h"
#include "trainer/curriculum/scheduler.h"
#include "trainer/data/batch.h"
#include "trainer/policy/config.h"

namespace etude::learn {

/// AdamW (Loshchilov & Hutter 2019), linear warm-up, cosine over the run.
struct OptimizerConfig {
  double lr = 3e-3;
  double beta1 = 0.9;
  double beta2 = 0.98;
  double epsilon = 1e-8;
  double weight_decay = 0.01;  ///< of matrices and kernels, not of vectors
  int warmup_steps = 100;
  std::string schedule = "cosine";  ///< cosine | constant
  double final_lr = 0.01;           ///< fraction of lr at the end of the cosine
  double clip = 1;                  ///< global gradient norm; 0: not clipped

  void Visit(auto& v) {
    v("lr", lr, "-", "largest learning rate of AdamW");
    v("beta1", beta1, "-", "decay of the gradient's mean");
    v("beta2", beta2, "-", "decay of the gradient's square");
    v("epsilon", epsilon, "-", "what keeps the division finite");
    v("weight_decay", weight_decay, "-", "of matrices and kernels, not of vectors");
    v("warmup_steps", warmup_steps, "steps", "over which the learning rate rises from 0");
    v("schedule", schedule, "", "cosine | constant");
    v("final_lr", final_lr, "-", "fraction of lr at the end of the cosine");
    v("clip", clip, "-", "largest global norm of the gradient; 0: not clipped");
  }
};

struct EvalConfig {
  int every_steps = 250;
  int frames = 384;  ///< of the validation split, spread over tasks, episodes and phases

  void Visit(auto& v) {
    v("every_steps", every_steps, "steps", "between two evaluations");
    v("frames", frames, "-", "pictures of the validation split, spread over tasks, episodes and phases");
  }
};

struct CheckpointConfig {
  int every_steps = 500;  ///< besides the end, stages that validation ends and, in the last one, every new best
  int keep = 3;           ///< newest files kept, besides the best

  void Visit(auto& v) {
    v("every_steps", every_steps, "steps",
      "between two checkpoints, besides the end, stages that validation ends and, in the last one, every new best");
    v("keep", keep, "-", "newest files kept, besides the best");
  }
};

inline constexpr double kMostMinutes = 1e6;  ///< about two years

struct ThreadsConfig {
  /// Copies of the network, each on its own part of the batch with its own thread; gradients are
  /// averaged. Small networks run faster so than with threads inside each operation. 0: one a core, as far as each has
  /// kFewestPictures of a batch: it normalises by those alone, and what is served by many. A run that goes on has as
  /// many as before.
  int replicas = 0;
  int intra_op = 1;  ///< threads inside an operation, per replica

  static constexpr int kFewestPictures = 8;

  void Visit(auto& v) {
    v("replicas", replicas, "-",
      "copies of the network, each on its own part of the batch; 0: one a core, while each has 8 pictures");
    v("intra_op", intra_op, "-", "threads inside an operation, for each replica");
  }
};

/// What a run begins with: parts of a policy (trainer/policy/parts.h) out of a checkpoint. Once begun, resuming reads
/// `freeze` only.
struct InitConfig {
  std::string from;                 ///< a checkpoint's file; "": from scratch
  std::vector<std::string> copy;    ///< parts to take; none: all that both have, but `fresh`
  std::vector<std::string> fresh;   ///< parts that begin anew
  std::vector<std::string> freeze;  ///< parts that stay as they are, bit for bit
  std::vector<std::string> like;    ///< NEW=OLD: fresh parts that begin as another one of the checkpoint

  void Visit(auto& v) {
    v("from", from, "", "file of the checkpoint to begin with; empty: from scratch");
    v("copy", copy, "", "parts to take from it; none: all that both have, but `fresh`");
    v("fresh", fresh, "", "parts that begin anew");
    v("freeze", freeze, "", "parts that stay as they are, bit for bit");
    v("like", like, "",
      "NEW=OLD: a part that begins anew has the weights of another one of the checkpoint, where they fit");
  }
};

struct TrainConfig {
  std::string name = "compact";
  std::uint64_t seed = 1;
  std::uint64_t steps = 0;  ///< 0: no limit by steps
  double minutes = 0;       ///< 0: no limit by time; time of training, without waiting for first data
  double ema = 0;           ///< decay of the averaged weights used in evaluation and checkpoints; 0: off
  OptimizerConfig optimizer;
  data::DataConfig data;
  curriculum::CurriculumConfig curriculum;
  EvalConfig eval;
  CheckpointConfig checkpoint;
  ThreadsConfig threads;
  InitConfig init;
  policy::PolicyConfig policy;  ///< in a file also the name of a file in policies/ beside it, or `checkpoint`

  void Visit(auto& v) {
    v("name", name, "", "of the experiment");
    v("seed", seed, "-", "what everything random is drawn from");
    v("steps", steps, "steps", "length of the run; 0: no limit by steps");
    v("minutes", minutes, "min", "of training, without waiting for first data; 0: no limit by time");
    v("ema", ema, "-", "decay of the averaged weights in evaluation and checkpoints; 0: off");
    v("optimizer", optimizer, "", "AdamW");
    v("data", data, "", "batches, and how pictures are varied");
    v("curriculum", curriculum, "", "when which modules are trained");
    v("eval", eval, "", "errors on the validation split while it trains");
    v("checkpoint", checkpoint, "", "when checkpoints are written and published");
    v("threads", threads, "", "how a step is spread over cores");
    v("init", init, "", "the checkpoint that it begins with, part by part");
    v("policy", policy, "", "the graph of modules");
  }

  /// All problems at once.
  Status Validate() const;
};

/// The graph of a checkpoint file, as its policy_config says it. Given by whoever may read checkpoints.
using GraphReader = std::function<Result<OrderedJson>(const std::string& file)>;

/// `name_or_file`: a path, or the name of a file in `experiments` ("compact"). In it, or as an override:
/// `policy: NAME` is the content of policies/NAME.yaml ("compact/base") beside the file or in `experiments`;
/// `policy: checkpoint` is the graph of `init.from`. After it policy.a.b=c works too. `extends: NAME` in a policy's
/// file puts it on top of another one beside it (compose.h). `add: [NAME]` puts policies/FAMILY/NAME.yaml, or the file
/// NAME, on top of the graph, FAMILY being the first part of its name ("compact"); with `init.from` modules that it
/// does not name go on reading what they read, where that is "all".
/// @error kInvalidArgument: with the names there are; as LoadConfig and Validate. As `graph_of`.
Result<TrainConfig> LoadTrainConfig(const std::string& name_or_file, const Path& experiments,
                                    const std::vector<std::string>& overrides, const GraphReader& graph_of = {});

}  // namespace etude::learn

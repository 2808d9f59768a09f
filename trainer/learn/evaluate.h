// SPDX-License-Identifier: Apache-2.0
// Validation: what each module gets wrong, in units that people use.
#pragma once

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "trainer/data/batch.h"
#include "trainer/learn/tensors.h"
#include "trainer/policy/policy.h"

namespace etude::learn {

struct Evaluation {
  /// For people and files: "TAR2D.px", "TAR3D.cm", "LANG.accuracy" (0..1), "CTRL.cm" (mean over
  /// waypoints), "CTRL.first_cm", "CTRL.deg", "CTRL.gripper" (accuracy, 0..1), "EE2D.hit" (the most
  /// attended patch is the true one, 0..1), "loss".
  std::map<std::string, double> metrics;
  /// Module -> error in base units (1 - accuracy, px, m): lower is better; what the curriculum
  /// looks at.
  std::map<std::string, double> errors;
};

/// What is looked at, and how.
struct ValidationSet {
  const data::BatchMaker& maker;
  const data::Snapshot& snapshot;
  const std::vector<data::Sample>& samples;
  int level = 0;  ///< modules up to this one
  int batch = 64;
  std::function<void()> between = nullptr;  ///< before each batch: all of them may take long
};

/// Called with the samples of one batch, what the policy saw of them, and what it said.
using BatchVisitor =
    std::function<void(const std::vector<data::Sample>& samples, const Part& part, const policy::Outputs& outputs)>;

/// Batch after batch without augmentation, in evaluation mode; the policy is back in training mode afterwards.
/// @error of reading frames; kNotFound when there are no samples.
Status VisitBatches(policy::Policy& policy, const ValidationSet& set, const BatchVisitor& visit);

/// Measures modules of the set's levels, as VisitBatches visits it. Accuracies of relabelled sentences count as much as
/// the demonstrated one's. @error as VisitBatches
Result<Evaluation> Evaluate(policy::Policy& policy, const ValidationSet& set);

/// How often the policy's class head names the object that a sentence means, and its task head the task (0..1):
///   "LANG.unseen"  the paper's Table 11, which training never shows: other words, other order
///   "LANG.phrases" noun phrases of its Table 8, pushed
///   "LANG.noisy"   wordings like those of training, with typing errors, drawn from a seed of their own
///   "LANG.clauses" with something to keep off: what modules that are added later need of this one
/// by the modules' own names ("TASK.unseen"). Only about `tasks` and `nouns` (ObjectNoun), which the data have: the
/// heads may know more. Empty for a policy that has no such head which reads language alone.
std::map<std::string, double> EvaluateLanguage(policy::Policy& policy, const language::Grammar& grammar,
                                               const std::vector<std::string>& tasks,
                                               const std::vector<std::string>& nouns);

}  // namespace etude::learn

// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/sources/eval_source.cc
#include "dashboard/server/sources/eval_source.h"

#include <gtest/gtest.h>

#include "tests/dashboard/server/example_folders.h"
#include "tests/support/matchers.h"

namespace etude::sources {
namespace eval_source_test {

TEST(EvalSource, RowsOfTheStreamComeBeforeTheReportHasThem) {
  ExampleFolders lab;
  ASSERT_THAT(WriteFileAtomically(lab.root() / "eval_a" / "eval.jsonl",
                                  "{\"index\": 1, \"success\": false}\n{\"index\": 8, \"success\": true}\n"),
              IsOk());
  EvalSource source({Kind::kEval, "eval_a", "eval_a", lab.root() / "eval_a", "eval_a", ""});
  const auto view = source.View().value();
  ASSERT_EQ(view->rows.size(), 5u);
  EXPECT_TRUE(FlagOf(view->rows[1], "success")) << "the report's word on a rollout counts";
  EXPECT_EQ(UnsignedOf(view->rows[4], "index"), 8u);
  EXPECT_EQ(view->videos, (std::vector<std::string>{"000001-pick-success.mp4"}));
  EXPECT_TRUE(view->spec.is_object());
}

TEST(EvalSource, ADamagedReportIsAnError) {
  ExampleFolders lab;
  ASSERT_THAT(WriteFileAtomically(lab.root() / "eval_a" / "eval.json", "{\"cut"), IsOk());
  EvalSource source({Kind::kEval, "eval_a", "eval_a", lab.root() / "eval_a", "eval_a", ""});
  EXPECT_THAT(source.View(), HasCode(Code::kCorrupt));
}

}  // namespace eval_source_test
}  // namespace etude::sources

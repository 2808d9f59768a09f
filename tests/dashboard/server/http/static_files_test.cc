// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/http/static_files.cc
#include "dashboard/server/http/static_files.h"

#include <gtest/gtest.h>

#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude::http {
namespace static_files_test {

Request Ask(const std::string& path) {
  Request request;
  request.path = SplitPath(path).value();
  return request;
}

TEST(StaticFiles, PagesAreTheIndexAndFilesAreThemselves) {
  TemporaryFolder folder;
  ASSERT_THAT(WriteFileAtomically(folder / "web" / "index.html", "<!doctype html>"), IsOk());
  ASSERT_THAT(WriteFileAtomically(folder / "web" / "main-TTGKP5R6.js", "1"), IsOk());
  StaticFiles files(folder / "web");

  for (const char* path : {"/", "/training", "/dataset/a/3"}) {
    const auto page = files.Serve(Ask(path));
    ASSERT_THAT(page, IsOk()) << path;
    EXPECT_EQ(page->body, "<!doctype html>");
    EXPECT_EQ(page->caching, Caching::kRevalidate);
  }
  const auto script = files.Serve(Ask("/main-TTGKP5R6.js"));
  ASSERT_THAT(script, IsOk());
  EXPECT_EQ(script->content_type, "text/javascript; charset=utf-8");
  EXPECT_EQ(script->caching, Caching::kImmutable) << "its name has its content's hash";
  EXPECT_THAT(files.Serve(Ask("/none.js")), HasCode(Code::kNotFound));
}

TEST(StaticFiles, NothingOutsideTheFolderIsServed) {
  TemporaryFolder folder;
  ASSERT_THAT(WriteFileAtomically(folder / "web" / "index.html", "page"), IsOk());
  ASSERT_THAT(WriteFileAtomically(folder / "secret.txt", "secret"), IsOk());
  std::filesystem::create_symlink(folder / "secret.txt", folder / "web" / "link.txt");
  StaticFiles files(folder / "web");
  EXPECT_THAT(files.Serve(Ask("/link.txt")), HasCode(Code::kNotFound));
  EXPECT_THAT(files.Serve(Ask("/..%2Fsecret.txt")), HasCode(Code::kNotFound));
}

TEST(StaticFiles, SaysHowToBuildThePages) {
  TemporaryFolder folder;
  StaticFiles files(folder / "none");
  const auto answer = files.Serve(Ask("/"));
  ASSERT_THAT(answer, IsOk());
  EXPECT_EQ(answer->status, 503);
  EXPECT_NE(answer->body.find("npm ci"), std::string::npos);
}

}  // namespace static_files_test
}  // namespace etude::http

// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/http/encoding.cc
#include "dashboard/server/http/encoding.h"

#include <gtest/gtest.h>

namespace etude::http {
namespace encoding_test {

TEST(ParseRange, TakesOneRangeOfBytes) {
  struct Case {
    const char* header;
    RangeKind kind;
    std::uint64_t first, last;
  };
  for (const auto& [header, kind, first, last] :
       {Case{"bytes=0-99", RangeKind::kPart, 0, 99}, Case{"bytes=900-", RangeKind::kPart, 900, 999},
        Case{"bytes=-100", RangeKind::kPart, 900, 999}, Case{"bytes=-5000", RangeKind::kPart, 0, 999},
        Case{"bytes=990-5000", RangeKind::kPart, 990, 999}, Case{"bytes=1000-", RangeKind::kUnsatisfiable, 0, 0},
        Case{"bytes=-0", RangeKind::kUnsatisfiable, 0, 0}, Case{"", RangeKind::kNone, 0, 0},
        Case{"bytes=5-2", RangeKind::kNone, 0, 0}, Case{"bytes=0-1,5-6", RangeKind::kNone, 0, 0},
        Case{"lines=0-1", RangeKind::kNone, 0, 0}, Case{"bytes=a-b", RangeKind::kNone, 0, 0},
        Case{"bytes=18446744073709551616-", RangeKind::kNone, 0, 0}, Case{"bytes=-", RangeKind::kNone, 0, 0}}) {
    const auto range = ParseRange(header, 1000);
    ASSERT_EQ(range.kind, kind) << header;
    if (kind != RangeKind::kPart) continue;
    EXPECT_EQ(range.range.first, first) << header;
    EXPECT_EQ(range.range.last, last) << header;
  }
  EXPECT_EQ(ParseRange("bytes=0-0", 0).kind, RangeKind::kUnsatisfiable);
}

TEST(Accepts, HeedsRefusals) {
  EXPECT_TRUE(Accepts("gzip, deflate", "gzip"));
  EXPECT_TRUE(Accepts("br;q=1.0, gzip;q=0.5", "gzip"));
  EXPECT_FALSE(Accepts("gzip;q=0, deflate", "gzip"));
  EXPECT_FALSE(Accepts("", "gzip"));
  EXPECT_FALSE(Accepts("xgzip", "gzip"));
}

Answer Long() {
  Answer answer;
  answer.body = std::string(5000, 'x');
  return answer;
}

TEST(Finish, CompressesLongTextForThoseWhoTakeIt) {
  Request request;
  Answer plain = Long();
  Finish(request, plain);
  EXPECT_EQ(plain.body.size(), 5000u);

  request.accept_encoding = "gzip";
  Answer compressed = Long();
  Finish(request, compressed);
  EXPECT_EQ(compressed.content_encoding, "gzip");
  EXPECT_LT(compressed.body.size(), 200u);
  EXPECT_NE(compressed.etag, plain.etag) << "a strong tag names bytes";

  Answer picture = Long();
  picture.content_type = "image/png";
  Finish(request, picture);
  EXPECT_EQ(picture.content_encoding, "");
}

TEST(Finish, SaysThatNothingChanged) {
  Request request;
  Answer first = Long();
  Finish(request, first);
  request.if_none_match = "\"other\", \"" + first.etag + "\"";
  Answer second = Long();
  Finish(request, second);
  EXPECT_EQ(second.status, 304);
  EXPECT_TRUE(second.body.empty());
  Answer changed = Long();
  changed.body += "y";
  Finish(request, changed);
  EXPECT_EQ(changed.status, 200);
}

}  // namespace encoding_test
}  // namespace etude::http

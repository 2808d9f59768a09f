// SPDX-License-Identifier: Apache-2.0
// Tests worker/synthesis/shaded_view.cc, texture.cc, picture_file.cc and pattern.cc: what people look at
#include "worker/synthesis/shaded_view.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <numbers>

#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"
#include "tests/worker/synthesis/shapes.h"
#include "worker/synthesis/pattern.h"
#include "worker/synthesis/picture_file.h"
#include "worker/synthesis/texture.h"

namespace etude::synthesis {
namespace shaded_view_test {

using Eigen::Vector2d;
using Eigen::Vector3d;
using Pixel = std::array<int, 3>;

const Pixel kWhite{255, 255, 255}, kRed{200, 0, 0}, kBlue{0, 0, 200};

Pixel At(const Texture& texture, int x, int y) {
  const std::uint8_t* p = &texture.rgb[3 * (static_cast<std::size_t>(y) * texture.width + x)];
  return {p[0], p[1], p[2]};
}

Texture Plain(int width, int height, const Pixel& color) {
  Texture texture{width, height, {}};
  for (int i = 0; i < width * height; ++i) texture.rgb.insert(texture.rgb.end(), color.begin(), color.end());
  return texture;
}

struct Silhouette {
  int pixels = 0;
  Vector2d middle = Vector2d::Zero();  ///< px
};

Silhouette SilhouetteOf(const Texture& view) {
  Silhouette silhouette;
  for (int y = 0; y < view.height; ++y)
    for (int x = 0; x < view.width; ++x) {
      if (At(view, x, y) == kWhite) continue;
      ++silhouette.pixels;
      silhouette.middle += Vector2d(x + 0.5, y + 0.5);
    }
  silhouette.middle /= std::max(1, silhouette.pixels);
  return silhouette;
}

TEST(ShadedView, ABallIsADiscOfItsSizeInTheMiddle) {
  for (const double radius : {0.02, 0.04})
    for (const double yaw : {0.0, 1.3}) {
      const Texture view = ShadedView(Sphere(radius, 24), {}, {.size = 120, .extent = 0.12, .yaw = yaw});
      const Silhouette found = SilhouetteOf(view);
      const double r = 1000 * radius;  // px
      EXPECT_NEAR(found.pixels, std::numbers::pi * r * r, 2 * std::numbers::pi * r) << "within a pixel of its rim";
      EXPECT_LT((found.middle - Vector2d(60, 60)).norm(), 0.5);
    }
}

// The camera stands in +y: what is in -x is on the right, what is high is above, and a quarter turn brings +x to +y.
TEST(ShadedView, SidesAreWhereTheCameraSeesThem) {
  const auto middle_of = [](const Vector3d& centre, double elevation, double yaw) {
    const ViewOptions options{.size = 100, .extent = 0.1, .elevation = elevation, .yaw = yaw};
    return SilhouetteOf(ShadedView(Box({0.005, 0.005, 0.005}, centre), {}, options)).middle;
  };
  const double quarter = std::numbers::pi / 2;
  EXPECT_LT((middle_of({-0.02, 0, 0}, 0, 0) - Vector2d(70, 50)).norm(), 0.7);
  EXPECT_LT((middle_of({0, 0, 0.03}, 0, 0) - Vector2d(50, 20)).norm(), 0.7);
  EXPECT_LT((middle_of({0, 0.03, 0}, quarter, 0) - Vector2d(50, 80)).norm(), 0.7) << "from above, near is below";
  EXPECT_LT((middle_of({0, 0.02, 0}, 0, quarter) - Vector2d(70, 50)).norm(), 0.7) << "+y went to -x";
}

TEST(ShadedView, TheNearerOneHidesTheOtherInItsOwnColours) {
  Texture texture = Plain(2, 1, kRed);
  std::copy(kBlue.begin(), kBlue.end(), texture.rgb.begin() + 3);
  assets::Mesh near = Box({0.01, 0.01, 0.01}, {0, 0.03, 0}), far = Box({0.02, 0.01, 0.02}, {0, -0.03, 0});
  for (auto& uv : near.uv) uv = {0.25, 0.5};
  for (auto& uv : far.uv) uv = {0.75, 0.5};
  for (const bool near_first : {true, false}) {
    assets::Mesh both = near_first ? near : far;
    both.Append(near_first ? far : near);
    const Texture view = ShadedView(both, texture, {.size = 100, .extent = 0.1, .elevation = 0, .yaw = 0});
    const Pixel middle = At(view, 50, 50), beside = At(view, 66, 50);
    EXPECT_TRUE(middle[0] > 90 && middle[2] == 0) << "red in front";
    EXPECT_TRUE(beside[2] > 90 && beside[0] == 0) << "blue around";
    EXPECT_EQ(At(view, 80, 50), kWhite);
  }
}

TEST(ShadedView, TheLightComesFromAbove) {
  const Texture view = ShadedView(Sphere(0.04, 16), {}, {.size = 100, .extent = 0.1});
  EXPECT_GT(At(view, 50, 25)[0], At(view, 50, 80)[0] + 30);
}

/// A red square of 8 px on white, its rim mixed with the background.
Picture RedSquare() {
  Picture picture{.width = 32, .height = 32};
  for (int y = 0; y < 32; ++y)
    for (int x = 0; x < 32; ++x) {
      const int inside = std::min({x - 11, 20 - x, y - 11, 20 - y});  // px from outside
      const Pixel color = inside > 1 ? kRed : inside == 1 ? Pixel{227, 127, 127} : kWhite;
      picture.rgb.insert(picture.rgb.end(), color.begin(), color.end());
      picture.mask.push_back(inside > 0);
      picture.depth.push_back(inside > 0 ? 1.0f : 0.0f);
    }
  return picture;
}

TEST(TextureOf, ContinuesTheObjectsColoursPastItsRim) {
  for (const int margin : {0, 2, 5}) {
    const Texture texture = TextureOf(RedSquare(), margin);
    for (int y = 0; y < 32; ++y)
      for (int x = 0; x < 32; ++x) {
        const int away = std::max({12 - x, x - 19, 12 - y, y - 19});  // px from the object, 0 on its rim
        if (away <= margin) {
          EXPECT_EQ(At(texture, x, y), kRed) << margin << ": " << x << " " << y;
        } else {
          EXPECT_EQ(At(texture, x, y), kWhite) << margin << ": " << x << " " << y;
        }
      }
  }
}

TEST(ToTexFile, IsTwoNumbersAndTheColours) {
  const Texture texture = Plain(3, 2, {1, 2, 3});
  const auto bytes = ToTexFile(texture);
  ASSERT_EQ(bytes.size(), 8u + 18u);
  std::int32_t size[2];
  std::memcpy(size, bytes.data(), sizeof size);
  EXPECT_THAT(size, testing::ElementsAre(3, 2));
  EXPECT_TRUE(std::equal(texture.rgb.begin(), texture.rgb.end(), bytes.begin() + 8));
}

TEST(PictureFile, APaletteHasAColumnForEachColour) {
  const std::vector<Vector3d> colors{{1, 0, 0}, {0, 1, 0}, {2, -1, 0.5}};
  const Texture palette = PaletteTexture(colors);
  const std::vector<Pixel> expected{{255, 0, 0}, {0, 255, 0}, {255, 0, 128}};
  for (std::size_t i = 0; i < colors.size(); ++i) {
    // where ReadMesh puts a material's texture coordinates
    const int x = static_cast<int>((i + 0.5) / colors.size() * palette.width);
    EXPECT_EQ(At(palette, x, palette.height / 2), expected[i]);
  }
  EXPECT_EQ(At(PaletteTexture({}), 0, 0), (Pixel{179, 179, 179})) << "grey";
}

TEST(PictureFile, PngKeepsEveryPixelAndWhatIsNoneIsNamed) {
  Texture texture = Plain(5, 4, kRed);
  for (std::size_t i = 0; i < texture.rgb.size(); ++i) texture.rgb[i] = static_cast<std::uint8_t>(37 * i);
  const auto read = DecodePicture(EncodePng(texture).value(), "x.png");
  ASSERT_THAT(read, IsOk());
  EXPECT_EQ(read->width, 5);
  EXPECT_EQ(read->rgb, texture.rgb);
  EXPECT_THAT(DecodePicture({}, "x.png"), MessageHas("the texture of 'x.png' is not a picture"));
  EXPECT_THAT(DecodePicture({1, 2, 3}, "x.png"), HasCode(Code::kCorrupt));
}

TEST(PictureFile, AContactSheetHasItsTilesInRows) {
  TemporaryFolder folder;
  const std::vector<Tile> tiles{{Plain(40, 30, kRed), "a"}, {Plain(40, 30, kBlue), "b"}, {Plain(40, 30, kRed), "c"}};
  ASSERT_THAT(WriteContactSheet(tiles, 2, folder / "sheet.png"), IsOk());
  const auto sheet = DecodePicture(ReadBinaryFile(folder / "sheet.png").value(), "sheet");
  ASSERT_THAT(sheet, IsOk());
  EXPECT_EQ(sheet->width, 80);
  EXPECT_EQ(sheet->height, 2 * (30 + 18)) << "a line of captions below each row";
  EXPECT_EQ(At(*sheet, 20, 15), kRed);
  EXPECT_EQ(At(*sheet, 60, 15), kBlue);
  EXPECT_EQ(At(*sheet, 20, 48 + 15), kRed);
  EXPECT_EQ(At(*sheet, 60, 48 + 15), kWhite) << "no fourth tile";

  EXPECT_THAT(WriteContactSheet({}, 2, folder / "none.png"), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(WriteContactSheet(tiles, 0, folder / "none.png"), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(WriteContactSheet({tiles[0], {Plain(40, 31, kRed), "d"}}, 2, folder / "none.png"),
              MessageHas("a tile of 40 x 31 px beside one of 40 x 30"));
  EXPECT_FALSE(std::filesystem::exists(folder / "none.png"));
}

TEST(Pattern, TheNearestSpotIsTheNearestOfAll) {
  Rng rng(6);
  const double spacing = 0.1;
  // the spots themselves: where the offset is nothing
  std::vector<Vector2d> spots;
  for (int y = -6; y < 6; ++y)
    for (int x = -6; x < 6; ++x) {
      const Vector2d probe = spacing * Vector2d(x + 0.5, y + 0.5);
      spots.push_back(probe - NearestSpot(probe, spacing, 9).offset);
    }
  for (int i = 0; i < 500; ++i) {
    const Vector2d p(rng.Uniform(-0.4, 0.4), rng.Uniform(-0.4, 0.4));
    double nearest = 1;
    for (const Vector2d& spot : spots) nearest = std::min(nearest, (p - spot).norm());
    EXPECT_LE(NearestSpot(p, spacing, 9).offset.norm(), nearest + 1e-12);
  }
}

TEST(Pattern, DistanceToASegmentIsThatToItsNearestPoint) {
  Rng rng(7);
  for (int i = 0; i < 200; ++i) {
    const Vector2d a(rng.Normal(), rng.Normal()), b(rng.Normal(), rng.Normal()), p(rng.Normal(), rng.Normal());
    double nearest = 100;
    for (int k = 0; k <= 2000; ++k) nearest = std::min(nearest, (p - a - k / 2000.0 * (b - a)).norm());
    EXPECT_NEAR(SegmentDistance(p, a, b), nearest, 2e-3);
  }
}

TEST(Pattern, ADomeIsRoundAndOverMixes) {
  for (double share = 0; share < 1; share += 0.1)
    EXPECT_NEAR(share * share + std::pow(Dome(share, 0.3) / 0.3, 2), 1, 1e-9);
  EXPECT_EQ(Dome(1.5, 0.3), 0);
  Texel texel{Color(1, 0, 0), 0.2};
  Over(texel, Color(0, 0, 1), 0.25);
  EXPECT_LT((texel.color - Color(0.75, 0, 0.25)).norm(), 1e-12);
  Over(texel, Color(0, 1, 0), 7);
  EXPECT_LT((texel.color - Color(0, 1, 0)).norm(), 1e-12) << "no more than all of it";
  EXPECT_EQ(texel.height, 0.2);
}

}  // namespace shaded_view_test
}  // namespace etude::synthesis

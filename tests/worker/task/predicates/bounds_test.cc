// SPDX-License-Identifier: Apache-2.0
// Tests the bounds of every kind in worker/task/predicates: on which side of them it holds, whether on them, and which
// values may be written.
#include <cmath>
#include <functional>
#include <limits>

#include "tests/worker/task/predicates/scene.h"
#include "worker/task/predicates/kind.h"

namespace etude::task {
namespace bounds_test {

/// One quantity that a predicate bounds. All bounds are powers of two, and so are the places: nothing is rounded.
struct BoundCase {
  std::string yaml;
  std::function<void(Observation&, double)> put;  ///< makes the scene have that quantity
  double bound = 0;
  int holds = 1;    ///< above it; -1: below it
  bool on = false;  ///< whether on it, too
};

/// A large box (milk) on the table with its middle over the origin, and a small cube (coke) of half 1/16 m.
class Bounds : public PredicateTest {
 protected:
  Bounds() {
    milk().X_WO = milk().X_WO_start = At(0, 0, 0.25);
    milk().half_extent = {0.25, 0.25, 0.25};
    coke().X_WO = coke().X_WO_start = At(0, 0, 0.0625);
    coke().half_extent = {0.0625, 0.0625, 0.0625};
    bread().X_WO = bread().X_WO_start = At(1, 0, 0.0625);
    coke().contacts = {"milk"};
  }
  bool Holds(const BoundCase& bound, double value) {
    Observation scene = now;
    bound.put(scene, value);
    return Make(bound.yaml)->Observe(scene);
  }
  void Check(const std::vector<BoundCase>& bounds, double step) {
    for (const auto& bound : bounds) {
      EXPECT_TRUE(Holds(bound, bound.bound + bound.holds * step)) << bound.yaml;
      EXPECT_FALSE(Holds(bound, bound.bound - bound.holds * step)) << bound.yaml;
    }
  }
};

void PutX(Observation& scene, double x) { scene["coke"].X_WO.p.x() = x; }
void PutY(Observation& scene, double y) { scene["coke"].X_WO.p.y() = y; }
void PutZ(Observation& scene, double z) { scene["coke"].X_WO.p.z() = z; }

std::vector<BoundCase> Lengths() {
  const auto speed = [](Observation& scene, double value) { scene["coke"].speed = value; };
  const auto bread = [](Observation& scene, double x) { scene["bread"].X_WO.p.x() = 1 + x; };
  const auto left = [](double x, double y) {
    return [=](Observation& scene, double value) {
      scene["coke"].X_WO.p = {x == 0 ? value : x, y == 0 ? value : y, 0.5};
    };
  };
  const std::string beside = "{beside: {side: left, near: 0.25 m, far: 0.5 m, aside: 0.125 m}}";
  const auto over = [](Observation& scene, double gap) { scene["coke"].X_WO.p = {0, 0, 0.5625 + gap}; };
  const auto aside = [](Observation& scene, double x) { scene["coke"].X_WO.p = {x, 0, 0.5625}; };
  const auto lying = [](Observation& scene, double z) { scene["coke"].X_WO = At(0, 0, z, {kQuarter, 0, 0}); };
  return {{"{at_rest: {slower_than: 0.25 m/s}}", speed, 0.25, -1},
          {"{low: {below: 0.25 m}}", PutZ, 0.25, -1},
          {"{risen: {by: 0.5 m}}", PutZ, 0.5625, 1},
          {"{risen: {by: 0.5 m, from: table}}", PutZ, 0.5, 1},
          {"{moved: {by: 0.5 m}}", PutX, 0.5, 1},
          {"{moved: {by: 0.5 m}}", PutY, -0.5, -1},
          {"{moved: {by: 0.5 m, along: +x}}", PutX, 0.5, 1},
          {"{moved: {by: 0.5 m, along: -x}}", PutX, -0.5, -1},
          {"{moved: {by: 0.5 m, along: +y}}", PutY, 0.5, 1},
          {"{moved: {by: 0.5 m, along: -y}}", PutY, -0.5, -1},
          {"{moved: {by: 0.5 m, along: behind}}", PutY, -0.5, -1},
          {"{moved: {by: 0.5 m, along: right}}", PutX, -0.5, -1},
          {"{untouched: {within: 0.5 m}}", bread, 0.5, -1, /*on=*/true},
          {"{untouched: {within: 0.5 m}}", bread, -0.5, 1, /*on=*/true},
          {beside, left(0, -0.0625), 0.25, 1},
          {beside, left(0, -0.0625), 0.5, -1},
          {beside, left(0.375, 0), 0.125, -1},
          {beside, left(0.375, 0), -0.125, 1},
          {"{on: {within: 0.0625 m}}", over, 0.0625, -1},
          {"{on: {within: 0.0625 m}}", over, -0.0625, 1},
          {"{on: {aside: 0.25 m}}", aside, 0.25, -1},
          {"{on: {aside: 0.25 m}}", aside, -0.25, 1},
          {"{inside: {deep: 0.125 m}}", PutX, 0.25, -1},
          {"{inside: {deep: 0.125 m}}", PutY, -0.25, 1},
          {"{inside: {deep: 0.125 m}}", PutZ, 0.4375, -1},
          {"{lying: {below: 0.25 m}}", lying, 0.25, -1}};
}

TEST_F(Bounds, OfLengthsAndSpeedsHoldOnOneSide) { Check(Lengths(), 1e-9); }

TEST_F(Bounds, OfLengthsAndSpeedsAreMetOnlyWhereItIsSaid) {
  for (const auto& bound : Lengths()) EXPECT_EQ(Holds(bound, bound.bound), bound.on) << bound.yaml;
}

TEST_F(Bounds, OfAnglesHoldOnOneSide) {
  const auto lean = [](Observation& scene, double angle) { scene["coke"].X_WO = At(0, 0, 0.0625, {angle, 0, 0}); };
  Check({{"{upright: {within: 0.5 rad}}", lean, 0.5, -1},
         {"{upright: {within: 0.5 rad}}", lean, -0.5, 1},
         {"{lying: {within: 0.5 rad}}", lean, kQuarter - 0.5, 1},
         {"{lying: {within: 0.5 rad}}", lean, kQuarter + 0.5, -1},
         {"{turned: {by: 1 rad, within: 0.25 rad}}", lean, 0.75, 1},
         {"{turned: {by: 1 rad, within: 0.25 rad}}", lean, 1.25, -1},
         {"{turned: {by: 1 rad, within: 0.25 rad}}", lean, -1.25, 1}},
        1e-6);
}

/// Every kind with every parameter that it has.
class Written : public PredicateTest {
 protected:
  static Result<std::unique_ptr<Predicate>> With(const PredicateKind& kind, const std::string& name,
                                                 const PredicateValue& value) {
    return MakePredicate({.kind = kind.name, .parameters = {{name, value}}}, TheCast());
  }
  static void Refused(const PredicateKind& kind, const std::string& name, const PredicateValue& value,
                      const std::string& says) {
    const auto made = With(kind, name, value);
    ASSERT_FALSE(made.has_value()) << kind.name << "." << name << " " << value.number << value.unit << value.word;
    EXPECT_EQ(made.error().code, Code::kInvalidArgument);
    EXPECT_THAT(made.error().message, testing::HasSubstr("'" + kind.name + "': " + name + ": "));
    EXPECT_THAT(made.error().message, testing::HasSubstr(says));
  }
};

TEST_F(Written, NumbersMayBeBothEndsOfTheirRangeAndNothingBeyond) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  int numbers = 0;
  for (const auto& kind : PredicateKinds())
    for (const auto& parameter : kind.parameters) {
      if (parameter.type != PredicateParameter::Type::kNumber) continue;
      ++numbers;
      for (const double end : {parameter.low, parameter.high}) {
        EXPECT_TRUE(With(kind, parameter.name, {.number = end, .unit = parameter.unit})) << kind.name << " " << end;
        EXPECT_TRUE(With(kind, parameter.name, {.number = end})) << "in its own unit where none is written";
      }
      for (const double beyond : {std::nextafter(parameter.low, -kInfinity), std::nextafter(parameter.high, kInfinity),
                                  kInfinity, -kInfinity, std::numeric_limits<double>::quiet_NaN()})
        Refused(kind, parameter.name, {.number = beyond, .unit = parameter.unit}, "not in ");
      Refused(kind, parameter.name, {.number = parameter.low, .unit = parameter.unit == "m" ? "rad" : "m"},
              "a quantity in " + parameter.unit);
      Refused(kind, parameter.name, {.word = "target"}, "a quantity in " + parameter.unit);
    }
  EXPECT_GE(numbers, 15);
}

TEST_F(Written, WordsAndNamesAreThoseThatAreKnown) {
  using Type = PredicateParameter::Type;
  for (const auto& kind : PredicateKinds())
    for (const auto& parameter : kind.parameters) {
      if (parameter.type == Type::kNumber) continue;
      const bool word = parameter.type == Type::kWord;
      const std::vector<std::string> names{"target", "reference", "bread"};
      for (const auto& known : word ? parameter.words : names)
        EXPECT_TRUE(With(kind, parameter.name, {.word = known})) << kind.name << "." << parameter.name << " " << known;
      EXPECT_EQ(With(kind, parameter.name, {.word = "others"}).has_value(), parameter.type == Type::kObjects);
      Refused(kind, parameter.name, {.word = "teapot"}, word ? "'teapot' is not known" : "has no 'teapot'");
      Refused(kind, parameter.name, {.number = 1}, "a word");
    }
}

// What a predicate looks at is what its cast says, whoever that is.
TEST_F(Written, ARoleIsWhoPlaysItAndANameIsItself) {
  const Cast swapped{.target = "milk", .reference = "coke", .objects = {"bread", "coke", "milk"}};
  const auto grasped = [&](const char* who, const Cast& cast) {
    auto made = MakePredicate({.kind = "grasped", .parameters = {{"object", {.word = who}}}}, cast);
    EXPECT_TRUE(made.has_value());
    return (*made)->Observe(now);
  };
  coke().grasped = true;
  EXPECT_TRUE(grasped("target", TheCast()));
  EXPECT_FALSE(grasped("target", swapped));
  EXPECT_TRUE(grasped("reference", swapped));
  EXPECT_TRUE(grasped("coke", TheCast()) && grasped("coke", swapped));
}

}  // namespace bounds_test
}  // namespace etude::task

// Every single fault that changes the outcome is found; a good program has no finding. What changes
// the outcome is not the verifier's to say: verify_reference.h decides.
#include <gtest/gtest.h>

#include "tests/planner/verify_mutants.h"
#include "tests/planner/verify_reference.h"

namespace reforge::mutation {
namespace {

constexpr std::size_t kPlaces = 5;  // of each kind in each program; the bench takes 50
constexpr double kPitch = 0.1;
// The judge takes a second each time: of the faults of one kind that the verifier lets pass, two in
// each program are put before it here, all of them in the bench.
constexpr int kJudged = 2;

class VerifyMutants : public ::testing::TestWithParam<std::size_t> {};

TEST_P(VerifyMutants, EveryFaultThatMattersIsFound) {
  const SmallPair pair = make_pair(recipes()[GetParam()]);
  ASSERT_LE(lines_of(pair.program).size(), 5000u);
  const Verification good = verify_pair(pair.inputs, pair.program, kPitch);
  ASSERT_TRUE(good.pass) << findings_of(good);
  const Box3 room = room_of(pair.inputs);
  const ReferenceOutcome expected = Reference(pair.inputs, room).run(pair.program);
  ASSERT_EQ(expected.broken, "");
  for (const Kind& kind : kinds()) {
    int passed = 0;
    each_mutant(pair, kind, kPlaces, [&](const Mutant& mutant, std::size_t place) {
      if (!verify_pair(mutant.inputs, mutant.program, kPitch).pass) return;
      if (++passed > kJudged) return;
      const std::string why = change(expected, Reference(mutant.inputs, room).run(mutant.program));
      EXPECT_EQ(why, "") << kind.name << " at " << place << " is not found";
    });
  }
}

INSTANTIATE_TEST_SUITE_P(Pairs, VerifyMutants, ::testing::Range<std::size_t>(0, 4),
                         [](const auto& tested) { return recipes()[tested.param].name; });

}  // namespace
}  // namespace reforge::mutation

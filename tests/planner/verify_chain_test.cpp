// What toolpaths and post-processor make, seen by the verifier: two readings of one rig meet here.
#include <gtest/gtest.h>

#include "planner/program/post.h"
#include "planner/toolpath/deposition.h"
#include "planner/toolpath/finishing.h"
#include "planner/toolpath/roughing.h"
#include "tests/planner/verify_world.h"

namespace reforge::verify {
namespace {

struct Chain {
  const World world;  // its solids and rig; its program is not used
  std::vector<BlockToolpath> blocks;
  RigDescription rig = world.inputs.rig;
  Mode mode = Mode::kStrict;

  void mill(const std::vector<Vec3>& directions) {
    const MillingOptions options = milling_options(rig, mode);
    const TriangleMesh none;
    const Surroundings solids{world.inputs.initial, *world.inputs.reused,
                              mode == Mode::kStrict ? *world.inputs.fixture : none};
    PartStock stock = part_stock(solids.initial, solids.reused, 2e5);
    const auto go_on = [] { return false; };
    const std::vector<MachinedSample> samples =
        machined_surface(solids.reused, *world.inputs.removed, 0.4);
    std::vector<char> done(samples.size(), 0);
    for (const Vec3& d : directions) {
      BlockToolpath path{BlockKind::kMill, Frame::along(d), {}};
      reforge::BlockStock block(stock, solids, path.frame, options.cutter);
      path.paths = rough(options, solids, go_on, block);
      const TipFloor floor(solids, path.frame, options, 0);
      const Clearance clearance(block.standing(), options.cutter);
      std::vector<char> wanted;
      for (std::size_t k = 0; k < samples.size(); ++k) {
        wanted.push_back(!done[k] && touchable(samples[k], path.frame, floor, clearance,
                                               options.cutter.ball_radius_mm));
      }
      finish(options, solids, samples, wanted, go_on, block, done, path.paths);
      block.commit(stock);
      blocks.push_back(std::move(path));
    }
  }

  void print() {
    BlockToolpath path{BlockKind::kPrint, Frame::along(Vec3::UnitZ()), {}};
    path.paths = deposit(deposition_options(rig, mode), *world.inputs.added, path.frame,
                         {{&*world.inputs.reused}, {}, {}}, [] { return false; })
                     .paths;
    blocks.push_back(std::move(path));
  }

  Verification verify() {
    PostJob job{"chain",
                mode,
                std::string(64, 'a'),
                {&world.inputs.initial, &*world.inputs.target, &*world.inputs.fixture}};
    const Result<Program> program = post_program(rig, job, blocks);
    EXPECT_TRUE(program) << (program ? "" : program.error().sentence);
    VerifyInputs inputs = world.inputs;
    inputs.rig = rig;
    inputs.mode = mode;
    inputs.initial_sha256 = job.stock_sha256;
    std::istringstream in(program->text);
    VerifyOptions options;
    options.pitch_mm = 0.1;
    Result<Verification> v = verify_program(in, inputs, options);
    EXPECT_TRUE(v);
    return std::move(*v);
  }
};

void expect_good(const Verification& v) {
  EXPECT_TRUE(v.pass) << all_of(v);
  EXPECT_NEAR(v.part.reused, 2280, 2280 * 0.02);
  EXPECT_LT(v.part.kept_cut, 4.0);
  EXPECT_NEAR(v.part.plan_covered, 128, 6);
  ASSERT_TRUE(v.part.milled);
  EXPECT_GT(v.part.milled->p01, -0.1);
  EXPECT_LT(v.part.milled->p95, 0.06);
}

TEST(VerifyChain, MilledAndPrintedOnABcTablePasses) {
  Chain chain;
  chain.mill({Vec3::UnitZ(), Vec3::UnitX()});
  chain.print();
  expect_good(chain.verify());
}

TEST(VerifyChain, MilledAndPrintedOnAnAcTableWithTurnedSignsPasses) {
  Chain chain;
  chain.rig.kinematics.table = RotaryTable::kAC;
  chain.rig.kinematics.sign_c = -1;
  chain.rig.kinematics.c_axis_point_mm = {1, -2, 0};
  chain.rig.kinematics.tilt_offset_mm = {0, 3, -10};
  chain.mill({Vec3::UnitX(), Vec3::UnitZ()});
  chain.print();
  expect_good(chain.verify());
}

TEST(VerifyChain, PaperModePasses) {
  Chain chain;
  chain.mode = Mode::kPaper;
  chain.mill({Vec3::UnitZ(), Vec3::UnitX()});
  chain.print();
  expect_good(chain.verify());
}

}  // namespace
}  // namespace reforge::verify

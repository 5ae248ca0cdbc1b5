#include <gtest/gtest.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <unistd.h>

#include <functional>

#include "support/folder_contents.hpp"
#include "synth/sequences_maker.hpp"
#include "synth/states_maker.hpp"
#include "tools/synth/procedural.hpp"

namespace weft::synth {
namespace {

/// Runs work in processes that are killed, each after twice as much of the processor's time as the
/// one before, until one ends by itself. The number of kills.
int run_killed(const std::function<void()>& work) {
  for (int kills = 0, ms = 50;; ++kills, ms *= 2) {
    const pid_t child = fork();
    if (child == 0) {
      itimerval limit{};
      limit.it_value = {ms / 1000, ms % 1000 * 1000};
      setitimer(ITIMER_PROF, &limit, nullptr);  // its signal ends a process as SIGKILL does
      work();
      _exit(0);
    }
    int status = 0;
    waitpid(child, &status, 0);
    if (WIFSIGNALED(status) && WTERMSIG(status) == SIGPROF) continue;
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << "it failed by itself: " << status;
    return kills;
  }
}

const StatesReport kQuiet = [](const StatesProgress&) {};
const auto kNever = [] { return false; };

class Killed : public testing::Test {
 protected:
  Killed() {
    write_simulation(in / "a.wsim", test::procedural_sack("a", 0.004f));
    write_simulation(in / "b.wsim", test::procedural_sack("b"));
  }

  /// make(folder): the set that must be the same after kills.
  void check(const std::function<void(const std::string&)>& make) {
    make(out / "whole");
    EXPECT_GT(run_killed([&] { make(out / "killed"); }), 3);
    EXPECT_EQ(test::folder_contents(out / "whole"), test::folder_contents(out / "killed"));
  }

  test::TemporaryFolder in, out;
};

TEST_F(Killed, StatesEndWithTheFolderOfAnUndisturbedRun) {
  StatesRecipe recipe;
  recipe.scenes = 3;
  recipe.views = 2;
  recipe.samples = 1;
  recipe.mesh_step_mm = 10.0;
  check([&](const std::string& folder) {
    make_states(*simulations_of_folder(in.string()), folder, recipe, "", 1, kQuiet, kNever);
  });
}

TEST_F(Killed, SequencesEndWithTheFolderOfAnUndisturbedRun) {
  SequencesRecipe recipe;
  recipe.scenes = 1;
  recipe.seconds = 0.2;
  recipe.samples = 1;
  check([&](const std::string& folder) {
    make_sequences(*simulations_of_folder(in.string()), folder, recipe, "", 1, kQuiet, kNever);
  });
}

}  // namespace
}  // namespace weft::synth

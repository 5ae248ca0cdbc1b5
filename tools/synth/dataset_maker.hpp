#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "synth/recipe.hpp"

namespace weft::synth {

/// A sequence of simulations (.wsim), made when they are asked for or there already.
class SimulationSource {
 public:
  virtual ~SimulationSource() = default;
  /// How many of them the set is made of.
  virtual int wanted() const = 0;
  /// The file of one, nullopt where it had to be given up (the next index takes its place) or
  /// stopped() became true. Called from several threads. Throws Error.
  virtual std::optional<std::string> get(int index, const std::function<bool()>& stopped) = 0;
};

/// The .wsim files of a folder, sorted by path. Throws Error where there is none.
std::unique_ptr<SimulationSource> simulations_of_folder(const std::string& folder);

/// Blender makes them in `folder`; those it finds there are kept. count: wanted().
std::unique_ptr<SimulationSource> simulations_by_blender(const std::string& folder, int seed,
                                                         int count,
                                                         const SimulationOptions& options);

/// The same for T-shirts in six states (simulate/tshirts.py); attempts: poses tried for each.
std::unique_ptr<SimulationSource> tshirt_states_by_blender(const std::string& folder, int seed,
                                                           int count, int attempts);

struct SynthProgress {
  int simulations = 0, given_up = 0, simulations_total = 0;
  int done = 0, skipped = 0, failed = 0, total = 0;  // scenes
  double seconds_left = -1.0;                        // negative: not known yet
  bool stopped = false;
  std::string error;  // of the scene that has just failed
};

struct MakeOptions {
  int seed = 1;
  int scenes = 0;  // 0: all views of all simulations
  RenderOptions render;
  std::string settings;  // what dataset.json says about how the set was made
  int jobs = 1;
};

/// Renders simulations into a data set of the IRI layout with manifest.jsonl (one JSON object a
/// scene), dataset.json (version and settings), summary.txt and contact-sheet.png. A simulation is
/// rendered as soon as all before it are there, since second garments are drawn from those.
/// Finished scenes are kept unless their simulation changed: a run may be cut off at any moment and
/// taken up again, or ask for more scenes. Same simulations, options and version give the same
/// bytes, whatever the number of jobs. Splits are by simulation: test-held-out where the cut is
/// reserved (fabrics reserved too), otherwise test-seen for test_share of them, train for the rest.
/// A view that shows next to nothing of its garment is drawn again. report is called by one thread
/// at a time. Throws Error when the folder was made with other settings, holds more scenes than
/// asked for or is being written by another program, or a simulation cannot be made or read.
SynthProgress make_dataset(SimulationSource& simulations, const std::string& out,
                           const MakeOptions& options,
                           const std::function<void(const SynthProgress&)>& report,
                           const std::function<bool()>& stopped);

}  // namespace weft::synth

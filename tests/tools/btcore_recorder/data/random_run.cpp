// Runs a tree with leaves, decorators and controls that do anything at random, and records the run: it made the
// recordings beside it, from BehaviorTree.CPP 4.10.0.
//
//     random_run TREE.xml OUT.btrec.txt SEED
//
// OUT.transitions has a line `UID STATUS` for each change of a status, then a line `= KEY VALUE` for each text and
// number on the root's blackboard at the end of the last tick, and `threads` if other threads have changed
// statuses. Exit code: 2 if the tree cannot be loaded, 3 if it cannot be recorded.
#include <random>
#include <sstream>

#include "btcore_recorder.hpp"

using namespace BT;
using std::chrono::microseconds;

std::mt19937 source;
int below(int limit) { return static_cast<int>(source() % static_cast<unsigned>(limit)); }
bool maybe(int percent) { return below(100) < percent; }

NodeStatus any_result() {
  if (maybe(5)) throw std::runtime_error("bad \"result\"");
  if (maybe(15)) return NodeStatus::SKIPPED;
  return maybe(60) ? NodeStatus::SUCCESS : NodeStatus::FAILURE;
}

/// Write, unless the entry has another type.
template <class T>
void write(const Blackboard::Ptr& board, const std::string& key, const T& value) {
  try {
    board->set(key, value);
  } catch (const std::exception&) {
  }
}

struct Spot {
  double x, y;
};
enum class Colour { RED = 1, BLUE = 2 };

/// Writes outputs and entries, and removes entries.
struct Write : SyncActionNode {
  using SyncActionNode::SyncActionNode;
  static PortsList providedPorts() {
    return {OutputPort<AnyTypeAllowed>("out"), OutputPort<int>("number"), OutputPort<Spot>("spot"),
            OutputPort<Colour>("colour")};
  }
  NodeStatus tick() override {
    for (int i = below(3); i > 0; --i) try {
        put();
      } catch (const std::exception&) {  // the entry has another type
      }
    return any_result();
  }
  void put() {
    static const std::string keys = "xyz";
    const std::string key(1, keys[static_cast<size_t>(below(3))]);
    switch (below(12)) {
      case 0: setOutput("out", 2.5); break;
      case 1: setOutput("out", std::string("te\"xt\n")); break;
      case 2: setOutput("out", std::vector<double>{1.5, 2}); break;
      case 3: setOutput("out", true); break;
      case 4: setOutput("number", below(100)); break;
      case 5: setOutput("spot", Spot{1, 2}); break;
      case 6: setOutput("colour", maybe(50) ? Colour::RED : Colour::BLUE); break;
      case 7: config().blackboard->set("a", below(5)); break;
      case 8: config().blackboard->set(key, below(5)); break;
      case 9: config().blackboard->set(key, std::string("text")); break;
      default: config().blackboard->unset(key);
    }
  }
};

/// Writes a queue for a Loop.
struct Items : SyncActionNode {
  using SyncActionNode::SyncActionNode;
  static PortsList providedPorts() { return {OutputPort<std::shared_ptr<std::deque<int>>>("queue")}; }
  NodeStatus tick() override {
    setOutput("queue", std::make_shared<std::deque<int>>(std::deque<int>{below(9), below(9), below(9)}));
    return NodeStatus::SUCCESS;
  }
};

struct Count : StatefulActionNode {
  using StatefulActionNode::StatefulActionNode;
  static PortsList providedPorts() { return {OutputPort<int>("out")}; }
  NodeStatus onStart() override {
    left = below(4);
    return onRunning();
  }
  NodeStatus onRunning() override {
    if (left-- <= 0) return any_result();
    try {
      setOutput("out", left);
    } catch (const std::exception&) {
    }
    return NodeStatus::RUNNING;
  }
  void onHalted() override {}
  int left = 0;
};

/// Wakes the tree up, and writes when it is halted.
struct Hold : StatefulActionNode {
  using StatefulActionNode::StatefulActionNode;
  static PortsList providedPorts() { return {OutputPort<int>("out")}; }
  NodeStatus onStart() override { return NodeStatus::RUNNING; }
  NodeStatus onRunning() override {
    if (maybe(30)) emitWakeUpSignal();
    return maybe(50) ? NodeStatus::RUNNING : maybe(50) ? NodeStatus::SUCCESS : NodeStatus::FAILURE;
  }
  void onHalted() override {
    if (maybe(50)) try {
        setOutput("out", 7);
      } catch (const std::exception&) {
      }
  }
};

struct StatefulWait : StatefulActionNode {
  StatefulWait(const std::string& name, const NodeConfig& config) : StatefulActionNode(name, config) {}
  static PortsList providedPorts() { return {}; }
  NodeStatus onStart() override { return maybe(50) ? NodeStatus::RUNNING : any_result(); }
  NodeStatus onRunning() override { return onStart(); }
  void onHalted() override {}
};
struct CoroutineWait : CoroActionNode {
  using CoroActionNode::CoroActionNode;
  static PortsList providedPorts() { return {}; }
  NodeStatus tick() override {
    for (int i = below(4); i > 0; --i) {
      write(config().blackboard, "x", i);
      setStatusRunningAndYield();
    }
    return maybe(50) ? NodeStatus::SUCCESS : NodeStatus::FAILURE;
  }
};
struct ThreadedWait : ThreadedAction {
  using ThreadedAction::ThreadedAction;
  static PortsList providedPorts() { return {}; }
  NodeStatus tick() override {
    std::this_thread::sleep_for(microseconds(300));
    return NodeStatus::SUCCESS;
  }
};

/// Lets another thread write an entry within the tick.
struct Check : ConditionNode {
  using ConditionNode::ConditionNode;
  static PortsList providedPorts() { return {}; }
  NodeStatus tick() override {
    const int number = below(9);
    if (maybe(30)) std::thread([this, number] { write(config().blackboard, "a", number); }).join();
    return maybe(50) ? NodeStatus::SUCCESS : NodeStatus::FAILURE;
  }
};

/// Ticks its child twice, halts it, ignores its exceptions, or returns RUNNING in any case.
struct Odd : DecoratorNode {
  Odd(const std::string& name, const NodeConfig& config) : DecoratorNode(name, config) {}
  static PortsList providedPorts() { return {}; }
  NodeStatus tick() override {
    if (maybe(30)) setStatus(NodeStatus::RUNNING);
    if (maybe(10)) {
      haltChild();
      return NodeStatus::FAILURE;
    }
    NodeStatus status;
    try {
      status = child()->executeTick();
      if (maybe(20)) status = child()->executeTick();
    } catch (const std::exception&) {
      if (maybe(50)) throw;
      return NodeStatus::FAILURE;
    }
    if (maybe(20)) resetChild();
    return maybe(70) ? status : NodeStatus::RUNNING;
  }
};

/// Ticks some children in any order, and halts some.
struct Anyhow : ControlNode {
  Anyhow(const std::string& name, const NodeConfig& config) : ControlNode(name, config) {}
  static PortsList providedPorts() { return {}; }
  NodeStatus tick() override {
    std::vector<size_t> order(children_nodes_.size());
    for (size_t i = 0; i < order.size(); ++i) order[i] = i;
    std::shuffle(order.begin(), order.end(), source);
    setStatus(NodeStatus::RUNNING);
    NodeStatus status = NodeStatus::SUCCESS;
    for (int i = below(3); i >= 0; --i) {
      if (static_cast<size_t>(i) >= order.size()) continue;
      status = children_nodes_[order[static_cast<size_t>(i)]]->executeTick();
      if (maybe(20)) haltChild(static_cast<size_t>(below(static_cast<int>(order.size()))));
    }
    if (status != NodeStatus::RUNNING && maybe(80)) resetChildren();
    return status == NodeStatus::SKIPPED ? NodeStatus::SUCCESS : status;
  }
};

/// A user's class that inherits the ticks of a built-in node.
struct OwnSequence : SequenceNode {
  OwnSequence(const std::string& name, const NodeConfig& config) : SequenceNode(name, false, config) {}
  static PortsList providedPorts() { return {}; }
};

/// Return the lines of the entries of the root's blackboard.
std::string entries_of(Tree& tree) {
  std::stringstream lines;
  const auto board = tree.rootBlackboard();
  for (const auto& view : board->getKeys()) {
    const std::string key(view);
    const auto value = board->getAnyLocked(key);
    if (value->isString()) lines << "= " << key << " " << nlohmann::json(value->cast<std::string>()) << "\n";
    if (value->isNumber()) lines << "= " << key << " " << value->cast<double>() << "\n";
  }
  return lines.str();
}

/// Tick or halt the tree, or change an entry. Return whether the tree was ticked.
bool act(Tree& tree, btcore::Recorder& recorder, int what) {
  const auto board = tree.rootBlackboard();
  try {
    switch (what) {
      case 0: tree.haltTree(); return false;
      case 1: write(board, "w", below(9)), write(board, "a", below(4)); return false;
      case 2: board->unset("w"); return false;
      case 3: tree.tickOnce(); return true;
      default: tree.tickExactlyOnce(); return true;
    }
  } catch (const std::exception& error) {
    recorder.note_exception(error);
    tree.haltTree();
    return false;
  }
}

int main(int, char** arguments) {
  std::stringstream content;
  content << std::ifstream(arguments[1]).rdbuf();
  const std::string xml = content.str();
  source.seed(static_cast<unsigned>(std::stoul(arguments[3])));

  BehaviorTreeFactory factory;
  factory.registerNodeType<Write>("Write");
  factory.registerNodeType<Items>("Items");
  factory.registerNodeType<Count>("Count");
  factory.registerNodeType<Hold>("Hold");
  factory.registerNodeType<Check>("Check");
  factory.registerNodeType<Odd>("Odd");
  factory.registerNodeType<Anyhow>("Anyhow");
  factory.registerNodeType<OwnSequence>("OwnSequence");
  const int wait = below(3);
  if (wait == 0) factory.registerNodeType<StatefulWait>("Wait");
  if (wait == 1) factory.registerNodeType<btcore::Recorded<CoroutineWait>>("Wait");
  if (wait == 2) factory.registerNodeType<btcore::Recorded<ThreadedWait>>("Wait");
  factory.registerScriptingEnum("RED", 1);

  const auto board = Blackboard::create();
  for (const char* key : {"a", "b", "c"}) board->set(key, 0);
  Tree tree;
  try {
    factory.registerBehaviorTreeFromText(xml);
    tree = factory.createTree("Main", board);
  } catch (const std::exception& error) {
    std::cerr << error.what() << std::endl;
    return 2;
  }
  const std::string path = arguments[2];
  std::ofstream transitions(path.substr(0, path.rfind(".btrec.txt")) + ".transitions");
  std::mutex mutex;
  bool has_threads = false;
  const auto thread = std::this_thread::get_id();
  std::vector<TreeNode::StatusChangeSubscriber> subscribers;
  tree.applyVisitor([&](TreeNode* node) {
    const auto write_change = [&, node](TimePoint, const TreeNode&, NodeStatus, NodeStatus status) {
      const std::lock_guard lock(mutex);
      has_threads |= std::this_thread::get_id() != thread;
      transitions << node->UID() << " " << static_cast<int>(status) << "\n";
    };
    subscribers.push_back(node->subscribeToStatusChange(write_change));
  });
  std::string entries;
  try {
    btcore::Recorder recorder(tree, xml, path);
    for (int i = 0; i < 12; ++i) {
      act(tree, recorder, below(12));
      if (wait == 2 || xml.find("msec") != std::string::npos) std::this_thread::sleep_for(microseconds(below(4) * 700));
    }
    if (act(tree, recorder, 4)) entries = entries_of(tree);
  } catch (const RuntimeError& error) {
    std::cerr << error.what() << std::endl;
    return 3;
  }
  transitions << entries << (has_threads ? "threads\n" : "");
  subscribers.clear();
  return 0;
}

% Feeds recorded samples to an exported controller.
% octave-cli replay.m CLASS OUTPUTS STATES INPUTS GIVEN FOUND: names with commas between, the number of inputs, and two
% files with rows of doubles. Prints {"self_test", "init", "flags", "step_us"}.
given = argv();
[make, outputs, states] = deal(str2func(given{1}), strsplit(given{2}, ','), strsplit(given{3}, ','));
file = fopen(given{5}, 'r');
samples = fread(file, [str2double(given{4}), Inf], 'double');
fclose(file);
rows = columns(samples);
found = zeros(numel(outputs) + numel(states), rows);
controller = make();
start = controller.init(samples(1, 1), samples(2:end, 1));
flags = 0;
for k = 1:rows
  out = controller.step(samples(1, k), samples(2:end, k));
  state = controller.state();
  flags = bitor(flags, out.flags);
  found(:, k) = [cellfun(@(name) out.(name), outputs), cellfun(@(name) state.(name), states)];
end
file = fopen(given{6}, 'w');
fwrite(file, found, 'double');
fclose(file);
best = Inf;
rows = min(rows, 2000);
for pass = 1:2
  timer = tic();
  for k = 1:rows
    controller.step(samples(1, k), samples(2:end, k));
  end
  best = min(best, toc(timer) / rows);
end
row = feval([given{1}, '_mex'], 'self_test');
printf('{"self_test": %d, "init": %d, "flags": %d, "step_us": %.3g}\n', row, start, flags, 1e6 * best);

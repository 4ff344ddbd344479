// Runs a scene beside a recording of it by the program, and compares the bits: Bits.exe SCENE RECORDING abi.txt
using System;
using System.Reflection;
using System.Runtime.InteropServices;
using Palpate;

static class Bits
{
    static void Need(bool holds, string what)
    {
        if (!holds) throw new Exception("this does not hold: " + what);
    }

    static void Same(World a, World b, Field field, int index)
    {
        double[] x = null, y = null;
        a.Read(field, index, ref x);
        b.Read(field, index, ref y);
        Need(x.Length == y.Length && x.Length > 0, field + " are as many");
        for (int i = 0; i < x.Length; ++i)
            Need(BitConverter.DoubleToInt64Bits(x[i]) == BitConverter.DoubleToInt64Bits(y[i]), field + " are the same bits");
    }

    static void Conversions()
    {
        // A quarter turn about z (up) takes x to y; in Unity, about its y (up), x to z.
        float x, y, z, w, px, py, pz;
        double s = Math.Sqrt(0.5);
        Coordinates.RotationToUnity(s, 0, 0, s, out x, out y, out z, out w);
        Coordinates.ToUnity(0, 1, 0, out px, out py, out pz);
        // q (1, 0, 0) q*, as Unity has it: v + 2 q x (q x v + w v)
        double cx = y * 0 - z * 0 + w, cy = z * 1 - x * 0, cz = x * 0 - y * 1;
        double rx = 1 + 2 * (y * cz - z * cy), ry = 2 * (z * cx - x * cz), rz = 2 * (x * cy - y * cx);
        Need(Math.Abs(rx - px) + Math.Abs(ry - py) + Math.Abs(rz - pz) < 1e-6, "rotations go where positions go");
        double[] pose = Coordinates.PoseFromUnity(1, 2, 3, x, y, z, w);
        Need(pose[0] == 1 && pose[1] == 3 && pose[2] == 2 && Math.Abs(pose[3] - s) < 1e-6 && Math.Abs(pose[6] - s) < 1e-6, "and back");
    }

    /// Joints of a hand as OpenXR has them (x side, y dorsal, z proximal, right-handed), and as Unity has them (z turned round).
    static void Hands()
    {
        // The finger points along palpate's y and its nail up: a quarter turn about z.
        double[] pose = HandJoints.FingerPose(0.1f, 0.2f, 0.3f, 0, 0, 0, 1, 0.1f, 0.2f, 0.32f);
        double s = Math.Sqrt(0.5);
        double[] wanted = { 0.1, 0.31, 0.2, s, 0, 0, s };
        for (int i = 0; i < 7; ++i) Need(Math.Abs(pose[i] - wanted[i]) < 1e-6, "a hand's finger points where its joint does");
        // Any rotation: x of the finger is the joint's z, z of the finger the joint's y, in palpate's world.
        Random random = new Random(3);
        for (int trial = 0; trial < 1000; ++trial)
        {
            double[] q = new double[4];
            double square = 0;
            for (int i = 0; i < 4; ++i) q[i] = random.NextDouble() - 0.5;
            foreach (double x in q) square += x * x;
            UnityEngine.Quaternion turn = new UnityEngine.Quaternion();
            double n = Math.Sqrt(square);
            turn = new UnityEngine.Quaternion((float)(q[0] / n), (float)(q[1] / n), (float)(q[2] / n), (float)(q[3] / n));
            double[] p = HandJoints.FingerPose(0, 0, 0, turn.x, turn.y, turn.z, turn.w, 0, 0, 0);
            float x1, y1, z1, w1;
            Coordinates.RotationToUnity(p[3], p[4], p[5], p[6], out x1, out y1, out z1, out w1);
            UnityEngine.Quaternion finger = new UnityEngine.Quaternion(x1, y1, z1, w1);
            UnityEngine.Vector3 tip = finger * new UnityEngine.Vector3(1, 0, 0) - turn * new UnityEngine.Vector3(0, 0, 1);
            UnityEngine.Vector3 nail = finger * new UnityEngine.Vector3(0, 1, 0) - turn * new UnityEngine.Vector3(0, 1, 0);
            foreach (float off in new[] { tip.x, tip.y, tip.z, nail.x, nail.y, nail.z }) Need(Math.Abs(off) < 1e-5, "fingers are turned as joints are");
        }
    }

    static void Call(object of, string method)
    {
        of.GetType().GetMethod(method, BindingFlags.Instance | BindingFlags.NonPublic).Invoke(of, null);
    }

    /// Components, as Unity would call them: a finger that follows a transform down onto the plane.
    static void Components(string scene)
    {
        PalpateFinger finger = new PalpateFinger();
        finger.follows = new UnityEngine.Transform();
        finger.follows.localPosition = new UnityEngine.Vector3(0, 0.006f, 0);
        PalpateObject plane = new PalpateObject();
        plane.thing = "object 0";
        PalpateWorld world = new PalpateWorld();
        world.scene = scene;
        world.children = new object[] { finger, plane };
        Call(world, "Awake");
        for (int k = 1; k <= 10; ++k)
        {
            UnityEngine.Time.fixedTimeAsDouble = 0.02 * k;
            Call(world, "FixedUpdate");
        }
        Need(world.World.Info.Step == 200, "fixed steps of 20 ms are 20 of palpate's");
        Need(finger.Force.y > 0.05f && Math.Abs(finger.Force.x) < 0.05f && finger.Area > 0, "it is pushed up, along y");
        Need(Math.Abs(finger.transform.localPosition.y - 0.006f) < 1e-3f, "its transform is the bone's");
        Call(world, "OnDestroy");
    }

    /// The same by a hand elsewhere: the world stands turned and moved in Unity, the joints do with it.
    static void HandComponent(string scene)
    {
        PalpateWorld world = new PalpateWorld();
        world.scene = scene;
        world.transform.localPosition = new UnityEngine.Vector3(1, 2, 3);
        world.transform.localRotation = new UnityEngine.Quaternion(0, (float)Math.Sqrt(0.5), 0, (float)Math.Sqrt(0.5));
        PalpateHand hand = new PalpateHand();
        hand.fingers = new[] { "thumb", "index" };
        hand.distal = new UnityEngine.Transform[] { null, new UnityEngine.Transform() };
        hand.tips = new UnityEngine.Transform[] { null, new UnityEngine.Transform() };
        // Its z along the finger's x, which is the world's x; 6 mm above the plane.
        foreach (UnityEngine.Transform joint in new[] { hand.distal[1], hand.tips[1] })
        {
            joint.parent = world.transform;
            joint.localRotation = new UnityEngine.Quaternion(0, (float)Math.Sqrt(0.5), 0, (float)Math.Sqrt(0.5));
            joint.localPosition = new UnityEngine.Vector3(joint == hand.tips[1] ? 0.01f : -0.01f, 0.006f, 0);
        }
        world.children = new object[] { hand };
        Call(world, "Awake");
        for (int k = 1; k <= 10; ++k)
        {
            UnityEngine.Time.fixedTimeAsDouble += 0.02;
            Call(world, "FixedUpdate");
        }
        FingerState felt = world.World.Finger(0);
        double[] wanted = { 0, 0, 0.006, 1, 0, 0, 0 };
        for (int i = 0; i < 7; ++i) Need(Math.Abs(felt.TrackedPose[i] - wanted[i]) < 1e-6, "a hand moves its finger");
        Need(felt.Force[2] > 0.05, "and it feels the plane");
        hand.seen = false;
        UnityEngine.Time.fixedTimeAsDouble += 0.02;
        Call(world, "FixedUpdate");
        Need(world.World.Finger(0).Silent > 0.015, "a hand that is not seen is said");
        Call(world, "OnDestroy");
    }

    /// What comes and goes, snapshots, recordings, many worlds: all that palpate.h has.
    static void ComesAndGoes(string folder)
    {
        FingerOptions index = new FingerOptions { Name = "index", Elements = 120, Pose = new double[] { 0, 0, 0.006, 1, 0, 0, 0 } };
        ObjectOptions table = new ObjectOptions { Name = "table", Shape = Shape.Plane, Friction = 0.5 };
        using (World world = World.Build(new[] { index }, new[] { table }, settings: new[] { "solver.newton_iterations=4" }))
        {
            Need(world.Text(Told.Settings) == "solver.newton_iterations=4" && world.Text(Told.Finger, 0) == "index", "texts are told");
            Need(world.Text(Told.Scene).Contains("friction = 0.5") && World.Version.Length > 0, "descriptions become a text");
            string file = folder + "/built.palpate";
            world.Record(file);
            world.KeepSnapshots(true);
            world.KeepFrames(30);
            world.Step(100);
            double[] positions = null, forces = null;
            FingerState seen = world.ReadSnapshot(0, ref positions, ref forces);
            double sum = 0;
            for (int i = 2; i < forces.Length; i += 3) sum += forces[i];
            Need(seen.Force[2] > 0.05 && Math.Abs(sum - seen.Force[2]) < 1e-12 && positions.Length == forces.Length, "a snapshot is whole");
            try { world.AddObject(table); Need(false, "nothing comes while it records"); }
            catch (PalpateException error) { Need(error.Code == -6, error.Message); }
            Need(world.Text(Told.Report).Contains(" frames shown") && World.ApiVersion == 1, "a report is made");
            world.EndRecording();
            using (World again = World.Replay(file, 1))
            {
                again.Step(100);
                Need(again.Replayed.Same == 1, "a recording from C# is replayed");
            }
            int thumb = world.AddFinger(new FingerOptions { Name = "thumb", Elements = 120, Pose = new double[] { -0.06, 0, 0.02, 1, 0, 0, 0 } });
            int ball = world.AddObject(new ObjectOptions { Shape = Shape.Sphere, Dimensions = new[] { 0.01 }, Mass = 0.01,
                                                           Pose = new double[] { 0, 0.1, 0.05, 1, 0, 0, 0 } });
            world.SetThimble(thumb, "chinello-3rrs");
            Need(world.List(Part.Fingers).Length == 2 && world.List(Part.Objects).Length == 2, "they are listed");
            Need(world.Thimble(world.List(Part.Thimbles)[0]).Finger == thumb, "the thumb wears a thimble");
            world.Step(20);
            Need(world.Object(ball).Moves == 1 && world.Object(ball).Pose[2] < 0.05, "a ball falls");
            using (World other = world.Clone())
            {
                World.StepMany(new[] { world, other }, 10);
                Same(world, other, Field.NetForces, -1);
            }
            world.SetThimble(thumb, null);
            world.RemoveObject(ball);
            world.RemoveFinger(thumb);
            Need(world.List(Part.Thimbles).Length == 0 && world.Info.FingerCount == 1 && world.Info.ObjectCount == 1, "they are gone");
            try { world.Object(ball); Need(false, "a removed id is no id"); }
            catch (PalpateException error) { Need(error.Message.Contains("has been removed"), error.Message); }
        }
    }

    /// Structs against abi.txt, which is what a C compiler says of palpate.h.
    static void Layout(string abi)
    {
        int compared = 0;
        Type native = typeof(World).Assembly.GetType("Palpate.Native");
        foreach (string line in System.IO.File.ReadAllLines(abi))
        {
            string[] words = line.Split(' ');
            string[] names = words[1].Split('.');
            if (words[0] != "struct" && words[0] != "field") continue;
            string name = names[0].Substring("Palpate".Length);
            Type type = typeof(World).Assembly.GetType("Palpate." + name) ?? native.GetNestedType(name, BindingFlags.NonPublic);
            Need(type != null, "C# has a struct " + name);
            if (words[0] == "struct") { Need(Marshal.SizeOf(type) == int.Parse(words[2]), line); continue; }
            string field = "";
            foreach (string part in names[1].Split('_')) field += char.ToUpper(part[0]) + part.Substring(1);
            if (name == "View" && field == "Shape") field = "Rows";
            Need(Marshal.OffsetOf(type, field).ToInt32() == int.Parse(words[3]), line);
            ++compared;
        }
        Need(compared > 60, "fields were compared");
    }

    /// All steps of a scene, as bits.c prints them.
    static int Print(string scene, int steps)
    {
        using (World world = World.Load(scene))
        {
            for (int step = 1; step <= steps; ++step)
            {
                world.Step(1);
                string line = step.ToString();
                Field[] fields = { Field.NetForces, Field.NetTorques, Field.BonePoses, Field.ObjectPoses, Field.ObjectForces, Field.JointsSent };
                foreach (Field field in fields)
                {
                    double[] numbers = null;
                    world.Read(field, field == Field.JointsSent ? 0 : -1, ref numbers);
                    foreach (double x in numbers) line += " " + BitConverter.DoubleToInt64Bits(x).ToString("x16");
                }
                Console.WriteLine(line);
            }
        }
        return 0;
    }

    static int Main(string[] arguments)
    {
        if (arguments[0] == "print") return Print(arguments[1], int.Parse(arguments[2]));
        Conversions();
        Hands();
        Components(arguments[0]);
        HandComponent(arguments[0]);
        Layout(arguments[2]);
        ComesAndGoes(System.IO.Path.GetDirectoryName(arguments[0]));
        using (World world = World.Load(arguments[0]))
        using (World replay = World.Replay(arguments[1], 1))
        {
            int finger = world.FindFinger("index");
            long steps = replay.Replayed.Steps;
            for (long k = 0; k < steps; ++k)
            {
                world.Step(1);
                replay.Step(1);
                Same(world, replay, Field.Nodes, finger);
                Same(world, replay, Field.Forces, finger);
                Same(world, replay, Field.JointsSent, 0);
                Same(world, replay, Field.NetForces, -1);
            }
            Need(replay.Replayed.Same == 1 && replay.Replayed.Done == steps, "the replay is the recording");
            FingerState felt = world.Finger(finger);
            Need(felt.Touching > 0 && felt.Force[2] > 0.05 && felt.Converged == 1, "it touches");
            Need(world.Thimble(0).JointCount == 3 && world.Info.ThimbleCount == 1, "structs are laid out as in C");
            byte[] state = world.Save();
            using (World branch = world.Clone())
            {
                world.SetFingerPose(finger, new double[] { 0, 0, 0.02, 1, 0, 0, 0 });
                world.Set("finger.index.material.young_kPa=20");
                world.Step(100);
                Need(world.Finger(finger).Touching == 0, "it was lifted");
                branch.Step(5);
            }
            try { world.Restore(state); Need(false, "another setting is refused"); }
            catch (PalpateException error) { Need(error.Message.Contains("other settings"), error.Message); }
            try { world.FindFinger("nobody"); Need(false, "nobody is found"); }
            catch (PalpateException error) { Need(error.Message.Contains("there are: index"), error.Message); }
            Console.WriteLine("{0} steps, the same bits; {1:X16}", steps, BitConverter.DoubleToInt64Bits(felt.Force[2]));
        }
        return 0;
    }
}

// Runs a scene beside a recording of it by the program, and compares the bits: Bits.exe SCENE RECORDING
using System;
using System.Reflection;
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

    /// All steps of a scene, as bits.c prints them.
    static int Print(string scene, int steps)
    {
        using (World world = World.Load(scene))
        {
            for (int step = 1; step <= steps; ++step)
            {
                world.Step(1);
                string line = step.ToString();
                Field[] fields = { Field.NetForces, Field.NetTorques, Field.BonePoses, Field.ObjectPoses, Field.JointsSent };
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
        Components(arguments[0]);
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
